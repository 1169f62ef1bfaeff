import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.detect.ranking import best_keypoints, ranked

points = st.tuples(st.integers(0, 3), st.integers(0, 3), st.integers(0, 2))


@settings(max_examples=60, deadline=None)
@given(rows=st.lists(points, max_size=20), n=st.integers(-1, 25))
def test_rank_is_score_then_row_then_column(rows, n):
    xy = np.array([(x, y) for x, y, _ in rows], np.float32).reshape(-1, 2)
    score = np.array([score for *_, score in rows], np.float32)
    expected = sorted(range(len(rows)), key=lambda i: (-score[i], xy[i, 1], xy[i, 0], i))[: max(n, 0)]
    assert ranked(xy, score, n).tolist() == expected
    keypoints = best_keypoints(xy, score, score + 1, n)
    np.testing.assert_array_equal(keypoints.xy, xy[expected])
    np.testing.assert_array_equal(keypoints.score, score[expected])
    np.testing.assert_array_equal(keypoints.scale, score[expected] + 1)


def test_ties_are_decided_after_rounding_to_float32():
    """The first point is worse in float64 only; as equals, the upper one comes first."""
    score = np.array([1.0, 1.0 + 1e-12])
    keypoints = best_keypoints(np.array([[0, 0], [0, 5]]), score, np.ones(2), 2)
    np.testing.assert_array_equal(keypoints.xy, [[0, 0], [0, 5]])


def test_keypoints_are_float32_even_where_there_are_none():
    for keypoints in (best_keypoints(np.zeros((0, 2)), [], [], 5), best_keypoints(np.ones((2, 2)), [1, 2], [1, 1], 1)):
        assert keypoints.xy.shape == (len(keypoints), 2)
        assert keypoints.xy.dtype == keypoints.score.dtype == keypoints.scale.dtype == np.float32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.detect.base import BaseDetector, best_keypoints, ranked
from sips_lit.types import Features, Keypoints


class Middle(BaseDetector):
    name = "Middle"


def test_it_describes_nothing_and_says_so():
    assert Middle.describes is False
    with pytest.raises(TypeError, match="Middle has no descriptor of its own"):
        Middle().detect_and_describe(np.zeros((4, 4), np.uint8), 3)


def test_points_are_those_that_it_describes():
    class Describing(Middle):
        def detect_and_describe(self, image, n):
            one = np.ones(n, np.float32)
            return Features(Keypoints(np.zeros((n, 2), np.float32), one, one), np.zeros((n, 8), np.uint8), "hamming")

    assert len(Describing().detect(np.zeros((4, 4), np.uint8), 3)) == 3
    with pytest.raises(TypeError, match="Middle has no descriptor of its own"):
        Middle().detect(np.zeros((4, 4), np.uint8), 3)


def test_its_scores_are_an_order_without_a_map():
    assert Middle.scores == "order"
    assert Middle().score_map(np.zeros((4, 4), np.uint8)) is None


points = st.tuples(st.integers(0, 3), st.integers(0, 3), st.integers(0, 2))


@settings(max_examples=60, deadline=None)
@given(rows=st.lists(points, max_size=20), n=st.integers(-1, 25))
def test_rank_is_score_then_row_then_column(rows, n):
    xy = np.array([(x, y) for x, y, _ in rows], np.float32).reshape(-1, 2)
    score = np.array([score for *_, score in rows], np.float32)
    expected = sorted(range(len(rows)), key=lambda i: (-score[i], xy[i, 1], xy[i, 0], i))[: max(n, 0)]
    assert ranked(xy, score, n).tolist() == expected
    keypoints, best = best_keypoints(xy, score, score + 1, n)
    assert best.tolist() == expected
    np.testing.assert_array_equal(keypoints.xy, xy[expected])
    np.testing.assert_array_equal(keypoints.score, score[expected])
    np.testing.assert_array_equal(keypoints.scale, score[expected] + 1)


def test_ties_are_decided_after_rounding_to_float32():
    """The first point is worse in float64 only; as equals, the upper one comes first."""
    score = np.array([1.0, 1.0 + 1e-12])
    keypoints, _ = best_keypoints(np.array([[0, 0], [0, 5]]), score, np.ones(2), 2)
    np.testing.assert_array_equal(keypoints.xy, [[0, 0], [0, 5]])


def test_keypoints_are_float32_even_where_there_are_none():
    for keypoints, _ in (
        best_keypoints(np.zeros((0, 2)), [], [], 5),
        best_keypoints(np.ones((2, 2)), [1, 2], [1, 1], 1),
    ):
        assert keypoints.xy.shape == (len(keypoints), 2)
        assert keypoints.xy.dtype == keypoints.score.dtype == keypoints.scale.dtype == np.float32

import dataclasses

import numpy as np
import pytest
from textured_scenes import keypoints

from sips_lit.types import Features, GreyImage, ImageSequence, Keypoints, Matches, Reason


class Bare(ImageSequence):
    """A sequence that knows nothing but its frames."""

    name, fingerprint = "bare", "0"

    def __len__(self) -> int:
        return 3

    def frame(self, index: int) -> GreyImage:
        return np.full((2, 3), index, np.uint8)


def test_what_a_data_set_lacks_is_none():
    bare = Bare()
    assert bare.camera(0) is None
    assert bare.pose(0) is None
    assert bare.depth(0) is None
    assert bare.right(0) is None
    assert bare.homography(0, 1) is None


def test_frames_are_named_so_that_they_sort():
    names = [Bare().frame_name(index) for index in (2, 10, 100)]
    assert names == ["bare_000002", "bare_000010", "bare_000100"]
    assert names == sorted(names)


def test_a_sequence_must_have_frames():
    with pytest.raises(TypeError, match="abstract"):
        ImageSequence()


@pytest.mark.parametrize(("n", "length"), [(0, 0), (2, 2), (5, 5), (99, 5)])
def test_the_best_are_the_first(n, length):
    points = keypoints(np.arange(10).reshape(5, 2))
    descriptors = np.arange(15, dtype=np.float32).reshape(5, 3)
    best = Features(points, descriptors, "l2").best(n)
    assert len(best) == len(best.keypoints) == length
    np.testing.assert_array_equal(best.keypoints.xy, points.xy[:length])
    np.testing.assert_array_equal(best.keypoints.score, points.score[:length])
    np.testing.assert_array_equal(best.keypoints.scale, points.scale[:length])
    np.testing.assert_array_equal(best.descriptors, descriptors[:length])
    assert best.norm == "l2"


@pytest.mark.parametrize("depth", [None, np.array([1, np.nan, 3, 4, 5])])
def test_some_points_with_all_that_belongs_to_them(depth):
    points = dataclasses.replace(keypoints(np.arange(10).reshape(5, 2)), depth=depth)
    features = Features(points, np.arange(15, dtype=np.uint8).reshape(5, 3), "hamming")
    for rows, expected in (([True, False, True, False, False], [0, 2]), ([3, 1], [3, 1]), ([False] * 5, [])):
        some = features[np.array(rows)]
        assert len(some) == len(some.keypoints) == len(expected)
        for name in ("xy", "score", "scale"):
            np.testing.assert_array_equal(
                getattr(some.keypoints, name), [getattr(points, name)[i] for i in expected] or getattr(points, name)[:0]
            )
        assert (some.keypoints.depth is None) == (depth is None)
        if depth is not None:
            np.testing.assert_array_equal(some.keypoints.depth, [depth[i] for i in expected])
        np.testing.assert_array_equal(
            some.descriptors, features.descriptors[expected] if expected else np.zeros((0, 3))
        )
        assert some.norm == "hamming"


def test_no_points_have_the_shapes_of_points():
    none = Keypoints.empty()
    assert len(none) == 0
    assert none.xy.shape == (0, 2)
    assert none.score.shape == none.scale.shape == (0,)
    assert {none.xy.dtype, none.score.dtype, none.scale.dtype} == {np.dtype(np.float32)}
    assert len(none.best(4)) == 0


def test_matches_have_a_length():
    index = np.array([3, 1], np.int64)
    assert len(Matches(index, index)) == 2
    assert len(Matches(index[:0], index[:0])) == 0


def test_records_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        keypoints([[0, 0]]).xy = np.zeros((2, 2), np.float32)


def test_reasons_fit_their_arrays():
    # stored in files: the numbers are fixed
    assert [(reason.name, int(reason)) for reason in Reason] == [
        ("INLIER", 0),
        ("UNMATCHED", 1),
        ("LOST", 2),
        ("FAR", 3),
        ("UNKNOWN", 4),
    ]
    reasons = np.array([0, 3], np.uint8)
    np.testing.assert_array_equal(reasons == Reason.INLIER, [True, False])

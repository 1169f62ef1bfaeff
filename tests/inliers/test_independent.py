import numpy as np
import pytest
from textured_scenes import keypoints

from sips_lit.inliers.independent import IndependentCheck
from sips_lit.types import FramePair, Inliers, Matches, Reason

IMAGE = np.zeros((10, 10), np.uint8)
PAIR = FramePair("p", 0, 1, (IMAGE, IMAGE), IMAGE, IMAGE)


class SamePlace(IndependentCheck):
    """Says that a match is an inlier if its points have the same coordinates."""

    @property
    def protocol(self):
        return {"inliers": "same_place"}

    def __call__(self, pair, keypoints0, keypoints1, matches):
        same = (keypoints0.xy[matches.index0] == keypoints1.xy[matches.index1]).all(1)
        reason = np.where(same, Reason.INLIER, Reason.FAR).astype(np.uint8)
        return Inliers(same, reason, np.ones(len(keypoints0), bool), np.ones(len(keypoints1), bool))


def test_a_check_of_ones_own_needs_a_call_and_a_protocol_only():
    check = SamePlace()
    assert (check.independent, check.uses_frames, check.uses_depth, check.stereo) == (True, False, False, None)
    prepared = check.prepare(PAIR, keypoints([[1, 1], [2, 2]]), keypoints([[2, 2], [3, 3]]))
    matches = Matches(np.array([0, 1]), np.array([1, 0]))
    for repeat in (0, 3):
        assert prepared(matches, repeat).inlier.tolist() == [False, True]


def test_a_check_without_a_call_is_none():
    with pytest.raises(TypeError, match="abstract"):
        IndependentCheck()

import dataclasses

import numpy as np
import pytest
from textured_scenes import keypoints, texture

from sips_lit.inference.matched_pair import MatchedPair
from sips_lit.render.matches import COLOURS
from sips_lit.types import Matches, Reason

POINTS = keypoints([[10, 10], [60, 20], [30, 50], [70, 60]])
IMAGE = texture(80, 100)
NO_TURN = np.eye(4)


def pair(inliers: int, homography=None, T_1_0=None, posed: bool = False, matches: int = 4) -> MatchedPair:
    index = np.arange(matches)[::-1]
    moved = keypoints(POINTS.xy + 3)
    sure, inlier = np.full(matches, 0.5, np.float32), np.arange(matches) < inliers
    return MatchedPair(IMAGE, IMAGE, POINTS, moved, Matches(index, index), sure, inlier, posed, homography, T_1_0)


def test_matched_points_are_in_the_order_of_the_matches():
    found = pair(4, np.eye(3))
    np.testing.assert_array_equal(found.xy0, POINTS.xy[::-1])
    np.testing.assert_array_equal(found.xy1 - found.xy0, 3)
    assert len(found) == 4
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.matches = None


def test_the_pose_in_parts():
    T = np.eye(4)
    T[:3, 3] = 0.6, 0, 0.8
    found = pair(4, T_1_0=T, posed=True)
    np.testing.assert_array_equal(found.R, np.eye(3))
    np.testing.assert_array_equal(found.t, [0.6, 0, 0.8])
    assert pair(4, np.eye(3)).R is None
    assert pair(4, np.eye(3)).t is None
    assert "t = 0.60 0.00 0.80" in found.model


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (pair(4, np.eye(3)), "homography (few inliers: may be chance)"),
        (pair(0), "no homography: the matches do not agree"),
        (pair(0, matches=3), "no homography: 3 of 4 matches that it needs"),
        (pair(0, matches=4, posed=True), "no pose: 4 of 5 matches that it needs"),
        (pair(4, T_1_0=NO_TURN, posed=True), "pose: 0.00 degrees, no translation seen (few inliers: may be chance)"),
    ],
)
def test_the_model_in_words(found, words):
    assert found.model == words


def test_the_picture_joins_inliers_and_tells_the_others():
    some = pair(2, np.eye(3)).picture()
    assert some.shape[1] == 2 * 100 + 6
    colours = {reason: np.abs(some.astype(int) - COLOURS[reason]).sum(2).min() for reason in COLOURS}
    assert colours[Reason.INLIER] < 30
    assert colours[Reason.FAR] < 30
    assert colours[Reason.UNKNOWN] > 60
    without = pair(0).picture()
    assert np.abs(without.astype(int) - COLOURS[Reason.UNKNOWN]).sum(2).min() < 30


def test_a_large_image_is_shrunk_with_its_points():
    whole, small = pair(4, np.eye(3)).picture(None), pair(4, np.eye(3)).picture(50)
    assert whole.shape[1] == 206
    assert small.shape[1] == 106
    green = np.abs(small.astype(int) - COLOURS[Reason.INLIER]).sum(2) < 90
    assert green[:40, :50].any()

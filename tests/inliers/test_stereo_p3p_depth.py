"""Depth of one image, of some points, or of none."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import poselib
import pytest
from stereo_points import SCENES, true_points
from textured_scenes import keypoints

from sips_lit.errors import BadInputError
from sips_lit.geometry.pose import translation_error
from sips_lit.inliers.stereo_p3p import StereoP3PInliers
from sips_lit.pairs.sampler import read_pair
from sips_lit.types import Matches, Reason

CHECK = StereoP3PInliers(iterations=500)


def test_depth_of_one_image_suffices():
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, right = true_points()
    truth = pair.geometry.T_1_0
    for lacking in ("depth0", "depth1"):
        half = replace(pair, geometry=replace(pair.geometry, **{lacking: None}))
        inliers = CHECK(half, points0, points1, matches)
        assert inliers.inlier[right].mean() > 0.9
        assert inliers.known0.all()
        assert inliers.known1.all()
        found = CHECK.prepare(half, points0, points1).estimate(matches)
        assert translation_error(found.T_1_0, truth) < 0.05
        assert found.inlier[right].mean() > 0.9


def test_both_ways_must_agree():
    """A match that only one way's pose explains: the other image's depth at its point is wrong."""
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, right = true_points()
    motion = np.linalg.norm(points1.xy[matches.index1] - points0.xy, axis=1)
    spoilt = int(np.where(right, motion, 0).argmax())  # near the epipole depth would not matter
    for image, points, index in ((0, points0, matches.index0), (1, points1, matches.index1)):
        name = f"depth{image}"
        depth = getattr(pair.geometry, name).copy()
        x, y = np.round(points.xy[index[spoilt]]).astype(int)
        depth[y, x] *= 0.3
        inliers = CHECK(replace(pair, geometry=replace(pair.geometry, **{name: depth})), points0, points1, matches)
        assert inliers.reason[spoilt] == Reason.FAR
        assert inliers.inlier[right].mean() > 0.9


def test_matches_without_any_depth_are_ignored():
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, _ = true_points()
    holes = [np.array(depth) for depth in (pair.geometry.depth0, pair.geometry.depth1)]
    x, y = np.round(points0.xy[7]).astype(int)
    holes[0][y, x] = np.nan
    x, y = np.round(points1.xy[matches.index1[7]]).astype(int)
    holes[1][y, x] = np.nan
    holed = replace(pair, geometry=replace(pair.geometry, depth0=holes[0], depth1=holes[1]))
    inliers = CHECK(holed, points0, points1, matches)
    assert inliers.reason[7] == Reason.UNKNOWN
    assert not inliers.known0[7]
    assert not inliers.known1[matches.index1[7]]
    assert inliers.known0.sum() == len(points0) - 1


@pytest.mark.parametrize("without", ["geometry", "depth", "baseline"])
def test_a_pair_without_depth_is_refused(without):
    pair = read_pair(SCENES["stereo"], 0, 1)
    lacking = {
        "geometry": None,
        "depth": replace(pair.geometry, right0=None, right1=None),
        "baseline": replace(pair.geometry, baseline=None),
    }[without]
    points0, points1, matches, _ = true_points()
    with pytest.raises(BadInputError, match=r"boards:0-1 has no depth maps and no stereo .* inliers=stereo_p3p needs"):
        CHECK(replace(pair, geometry=lacking), points0, points1, matches)


def test_a_point_of_unknown_depth_never_reaches_the_search(monkeypatch):
    points0, points1, matches, _ = true_points()
    pair = read_pair(SCENES["depth"], 0, 2)
    holes = [depth.copy() for depth in (pair.geometry.depth0, pair.geometry.depth1)]
    for depth in holes:
        depth[:, ::40] = np.nan
    pair = replace(pair, geometry=replace(pair.geometry, depth0=holes[0], depth1=holes[1]))
    given = []
    search = poselib.estimate_absolute_pose
    monkeypatch.setattr(poselib, "estimate_absolute_pose", lambda *args: given.append(args[:2]) or search(*args))
    unknown = CHECK(pair, points0, points1, matches).reason == Reason.UNKNOWN
    prepared = CHECK.prepare(pair, points0, points1)
    lacking = [~side.known for side in prepared.sides]
    assert lacking[0].any()
    assert lacking[1].any()
    assert [len(points) for _, points in given] == [(~lacking[0]).sum(), (~lacking[1]).sum()]
    assert all(np.isfinite(array).all() for arrays in given for array in arrays)
    np.testing.assert_array_equal(unknown, lacking[0][matches.index0] & lacking[1][matches.index1])


@pytest.mark.parametrize(("lacking", "usable"), [(None, 2), ("depth0", 1), ("depth1", 2)])
def test_usable_are_matches_whose_point_has_a_depth_where_the_pose_is_sought(lacking, usable):
    """Four matches: the last two points of image 0 and the last three of image 1 have no depth."""
    pair = read_pair(SCENES["depth"], 0, 2)
    holes = [np.full(depth.shape, 3, np.float32) for depth in (pair.geometry.depth0, pair.geometry.depth1)]
    holes[0][:, 25:], holes[1][:, 15:] = np.nan, np.nan
    geometry = replace(pair.geometry, depth0=holes[0], depth1=holes[1])
    if lacking:
        geometry = replace(geometry, **{lacking: None})
    points = keypoints([[10, 50], [20, 50], [30, 50], [40, 50]])
    turned = Matches(np.array([3, 2, 1, 0]), np.array([3, 2, 1, 0]))
    assert CHECK.prepare(replace(pair, geometry=geometry), points, points).usable(turned) == usable


class Constant:
    """A stereo matcher that sees everything at one disparity."""

    parameters = MappingProxyType({"of": "a test"})

    def disparity(self, image, partner, xy, to_the_right=True):
        return np.full(len(xy), 20.0)


def test_the_matcher_that_is_given_tells_the_depth():
    pair = read_pair(SCENES["stereo"], 0, 2)
    check = replace(CHECK, stereo=Constant())
    points = keypoints([[50, 60], [70, 80]])
    for side in check.prepare(pair, points, points).sides:
        np.testing.assert_allclose(side.points[:, 2], 250 * 0.4 / 20)
    assert check.protocol["stereo"] == {"of": "a test"}

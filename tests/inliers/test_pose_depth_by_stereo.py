"""True poses with depth from stereo partners, against true depth maps of the same scene."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from stereo_scenes import StereoScene, squeezed, squeezed_points
from textured_scenes import keypoints

from sips_lit.errors import BadInputError
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.pairs.sampler import read_pair
from sips_lit.train.labelling import label_pair
from sips_lit.types import Inliers, Keypoints, Matches, Reason

SCENES = {tells: StereoScene(3, tells) for tells in ("stereo", "depth")}
POINTS = [cv2.goodFeaturesToTrack(SCENES["depth"].frames[i], 200, 1e-3, 6).reshape(-1, 2) for i in (0, 2)]


def nearest_matches() -> Matches:
    """Each point of image 0 with the point of image 1 that is nearest to its true place, or with a random one."""
    pair = read_pair(SCENES["depth"], 0, 2)
    every = np.arange(len(POINTS[0])).repeat(len(POINTS[1]))
    other = np.tile(np.arange(len(POINTS[1])), len(POINTS[0]))
    right = PoseDepthInliers()(pair, keypoints(POINTS[0]), keypoints(POINTS[1]), Matches(every, other)).inlier
    index0 = np.concatenate([every[right], np.arange(len(POINTS[0]))])
    wrong = np.random.default_rng(0).integers(0, len(POINTS[1]), len(POINTS[0]))
    return Matches(index0, np.concatenate([other[right], wrong]))


def verify(tells: str, matches: Matches) -> Inliers:
    return PoseDepthInliers()(read_pair(SCENES[tells], 0, 2), keypoints(POINTS[0]), keypoints(POINTS[1]), matches)


def test_stereo_agrees_with_depth_maps():
    matches = nearest_matches()
    truth, stereo = verify("depth", matches), verify("stereo", matches)
    known = stereo.reason != Reason.UNKNOWN
    assert truth.inlier.sum() > 60
    assert (~truth.inlier).sum() > 60
    assert known.mean() > 0.8
    assert (stereo.inlier == truth.inlier)[known].mean() > 0.97
    assert stereo.known0.mean() > 0.7


def test_points_without_a_stereo_match_are_unknown():
    blank = [[159, 3], [160, 237]]
    pair = read_pair(SCENES["stereo"], 0, 2)
    g = pair.geometry
    unseen = replace(g, right0=np.full_like(g.right0, 9), right1=np.full_like(g.right1, 9))
    inliers = PoseDepthInliers()(
        replace(pair, geometry=unseen), keypoints(blank), keypoints(blank), Matches(np.arange(2), np.arange(2))
    )
    assert inliers.reason.tolist() == [Reason.UNKNOWN] * 2
    assert not inliers.known0.any()
    assert not inliers.known1.any()


def test_a_pair_without_poses_is_refused():
    pair = read_pair(SCENES["stereo"], 0, 2)
    unposed = replace(pair, geometry=replace(pair.geometry, T_1_0=None))
    none = np.zeros(0, np.int64)
    with pytest.raises(BadInputError, match="no pose, camera and depth"):
        PoseDepthInliers()(unposed, Keypoints.empty(), Keypoints.empty(), Matches(none, none))


def test_prepared_once_it_verifies_like_called():
    matches, pair = nearest_matches(), read_pair(SCENES["stereo"], 0, 2)
    prepared = PoseDepthInliers().prepare(pair, keypoints(POINTS[0]), keypoints(POINTS[1]))
    np.testing.assert_array_equal(prepared(matches).reason, verify("stereo", matches).reason)
    half = Matches(matches.index0[::2], matches.index1[::2])
    np.testing.assert_array_equal(prepared(half).reason, prepared(matches).reason[::2])


class Corner:
    """Describes a point by the pixels around it."""

    name, norm = "patch", "l2"

    def describe(self, image, points):
        patches = [cv2.getRectSubPix(image, (9, 9), (float(x), float(y))).ravel() for x, y in points.xy]
        return np.asarray(patches, np.float32)


def test_labels_in_parts_prepare_once():
    calls = []

    class Counted(PoseDepthInliers):
        def prepare(self, *args):
            calls.append(1)
            return super().prepare(*args)

    args = read_pair(SCENES["stereo"], 0, 2), keypoints(POINTS[0]), keypoints(POINTS[1]), Corner()
    labels = label_pair(*args, Counted(), parts=2)
    assert len(calls) == 1
    whole = label_pair(*args, PoseDepthInliers())
    for a, b in zip(labels[:2], whole[:2], strict=True):
        np.testing.assert_array_equal(a.reason, b.reason)
    assert whole[0].inlier.sum() > 20


def test_focal_lengths_that_differ_change_no_label():
    """The same pair in images three quarters as high; where its points are is known."""
    matches = nearest_matches()
    points = [keypoints(squeezed_points(xy)) for xy in POINTS]
    low = PoseDepthInliers()(squeezed(read_pair(SCENES["stereo"], 0, 2)), *points, matches)
    truth = verify("depth", matches)
    known = low.reason != Reason.UNKNOWN
    assert known.mean() > 0.7
    assert (low.inlier == truth.inlier)[known].mean() > 0.95

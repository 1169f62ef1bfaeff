"""Swapped axes and negatives."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from textured_scenes import flight, keypoints, near_and_far, texture

from sips_lit.errors import BadInputError
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.klt import KltInliers
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.pairs.sampler import read_pair
from sips_lit.train.augment import Augmentation, transpose_pair
from sips_lit.types import Camera, FramePair, Matches, ViewGeometry

PAIR = read_pair(flight(6), 0, 5)
QUIET = {"flip": 0, "photometric": 0}


def posed_pair(right: bool = False) -> FramePair:
    """A wall that is looked at askew by two different cameras, and its depth in both."""
    size = (80, 60)
    camera0 = Camera(np.array([[100.0, 0, 30], [0, 90, 20], [0, 0, 1]]), size)
    camera1 = Camera(np.array([[70.0, 0, 25], [0, 60, 30], [0, 0, 1]]), size)
    T = np.eye(4)
    T[:3, 3] = 0.3, 0.2, 0.1
    T[:3, :3] = cv2.Rodrigues(np.array([0.1, -0.05, 0.1]))[0]

    def depth(camera: Camera, normal: np.ndarray, distance: float) -> np.ndarray:
        y, x = np.mgrid[: size[1], : size[0]]
        rays = np.linalg.inv(camera.matrix) @ np.stack([x.ravel(), y.ravel(), np.ones(x.size)])
        return (distance / (normal @ rays)).reshape(size[::-1]).astype(np.float32)

    normal = np.array([0.1, 0.2, 1.0])
    normal1 = T[:3, :3] @ normal
    depth0, depth1 = depth(camera0, normal, 4.0), depth(camera1, normal1, 4.0 + normal1 @ T[:3, 3])
    image0, image1 = texture(60, 80, 1), texture(60, 80, 2)
    g = ViewGeometry(T, camera0, camera1, depth0, depth1)
    if right:
        g = replace(g, depth0=None, depth1=None, right0=image0, right1=image1, baseline=0.4)
    return FramePair("a:0-1", 0, 1, (image0, image1), image0, image1, None, g)


@pytest.mark.parametrize("check", [KltInliers(), HomographyInliers()])
def test_labels_stay(check):
    start, goal, matches = near_and_far(PAIR)
    before = check(PAIR, keypoints(start), keypoints(goal), matches)
    after = check(transpose_pair(PAIR), keypoints(start[:, ::-1]), keypoints(goal[:, ::-1]), matches)
    unturned = check(transpose_pair(PAIR), keypoints(start), keypoints(goal), matches)
    assert 20 < before.inlier.sum() < 60
    assert (before.inlier != after.inlier).sum() <= 1
    assert (before.inlier != unturned.inlier).sum() > 10  # the test can tell


def test_labels_by_pose_and_depth_stay():
    generator = np.random.default_rng(0)
    start, goal = generator.uniform([5, 5], [75, 55], (2, 400, 2))
    start = np.round(start)
    matches = Matches(np.arange(400), np.arange(400))
    check = PoseDepthInliers(threshold=20)
    before = check(posed_pair(), keypoints(start), keypoints(goal), matches)
    pair = transpose_pair(posed_pair())
    after = check(pair, keypoints(start[:, ::-1]), keypoints(goal[:, ::-1]), matches)
    assert 20 < before.inlier.sum() < 200
    np.testing.assert_array_equal(after.reason, before.reason)
    assert pair.geometry.camera0.size == (60, 80)
    assert all(image.shape == (80, 60) and image.flags.c_contiguous for image in (*pair.frames, pair.geometry.depth1))


def test_stereo_partners_forbid_it():
    pair = posed_pair(right=True)
    assert transpose_pair(pair) is pair


def test_how_often():
    augment = Augmentation(**QUIET, transpose=0.3, invert=0.6)
    made = [augment(PAIR, np.random.default_rng(seed)) for seed in range(300)]
    swapped = [pair.image0.shape == PAIR.image0.shape[::-1] for pair in made]
    negative = [pair.image0.mean() + PAIR.image0.mean() == pytest.approx(255) for pair in made]
    assert np.mean(swapped) == pytest.approx(0.3, abs=0.08)
    assert np.mean(negative) == pytest.approx(0.6, abs=0.08)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("flip", 2),
        ("transpose", -0.1),
        ("invert", float("nan")),
        ("photometric", 1.1),
        ("log2_zoom", -1),
        ("noise", -2),
        ("rotation", -0.1),
        ("contrast", 0),
        ("gamma", -1),
    ],
)
def test_what_no_augmentation_can_be(key, value):
    with pytest.raises(BadInputError, match=f"^{key} of the augmentation is "):
        Augmentation(**{key: value})


def test_negatives_are_what_the_detector_sees_alone():
    pair = Augmentation(**QUIET, invert=1)(PAIR, np.random.default_rng(0))
    np.testing.assert_array_equal(pair.image0, 255 - PAIR.image0)
    np.testing.assert_array_equal(pair.image1, 255 - PAIR.image1)
    np.testing.assert_array_equal(pair.frames[0], PAIR.frames[0])

"""Each image has its own camera: larger, squeezed, mirrored."""

from dataclasses import replace

import numpy as np
import pytest
from stereo_points import SCENES, true_points
from stereo_scenes import CAMERA, squeezed, squeezed_points
from textured_scenes import keypoints

from sips_lit.geometry.image_changes import resize_camera
from sips_lit.geometry.pose import PoseEstimate, rotation_error, translation_error
from sips_lit.inliers.stereo_p3p import StereoP3PInliers
from sips_lit.pairs.sampler import read_pair
from sips_lit.train.augment import mirror_pair
from sips_lit.types import Camera, Reason

CHECK = StereoP3PInliers(iterations=500)


def test_a_mirror_changes_little():
    pair = read_pair(SCENES["stereo"], 0, 2)
    points0, points1, matches, right = true_points()
    size = np.array(CAMERA.size)
    turned = [keypoints((size - 1 - p.xy) * [1, 0] + p.xy * [0, 1], p.score) for p in (points0, points1)]
    inliers = CHECK(mirror_pair(pair, True, False), *turned, matches)
    judged = inliers.reason != Reason.UNKNOWN
    assert inliers.inlier[judged & right].mean() > 0.9
    assert inliers.inlier[~right].mean() < 0.05


def test_each_image_has_its_own_camera():
    """Image 1 is enlarged: its camera and its points are those of another size."""
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, right = true_points()
    size = (2 * CAMERA.size[0], 2 * CAMERA.size[1])
    larger = replace(pair.geometry, camera1=resize_camera(CAMERA, size), depth1=None)
    enlarged = keypoints(points1.xy * 2 + 0.5)
    found = CHECK.prepare(replace(pair, geometry=larger), points0, enlarged).estimate(matches)
    assert translation_error(found.T_1_0, pair.geometry.T_1_0) < 0.05
    assert found.inlier[right].mean() > 0.9


def test_each_direction_is_searched_with_the_camera_it_ends_in_and_the_given_limits(monkeypatch):
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, _ = true_points()
    other = Camera(CAMERA.matrix * [[1.1], [1.1], [1]], CAMERA.size)
    pair = replace(pair, geometry=replace(pair.geometry, camera1=other))
    given = []

    def search(points, pixels, camera, generator, iterations, threshold):
        given.append((camera, iterations, threshold, tuple(generator.integers(1000, size=4))))
        return PoseEstimate(None, np.zeros(len(points), np.bool_))

    monkeypatch.setattr("sips_lit.inliers.stereo_p3p.p3p_ransac", search)
    StereoP3PInliers(threshold=2.5, iterations=70, seed=3)(pair, points0, points1, matches)
    assert [camera is other for camera, *_ in given] == [True, False]
    assert [limits for _, *limits, _ in given] == [[70, 2.5]] * 2
    StereoP3PInliers(seed=3)(replace(pair, index1=pair.index1 + 1), points0, points1, matches)
    assert len({samples for *_, samples in given}) == 4  # others for each direction and each pair


@pytest.mark.parametrize("tells", ["stereo", "depth"])
def test_the_pose_is_in_metres_where_focal_lengths_differ(tells):
    pair = read_pair(SCENES[tells], 0, 2)
    points0, points1, matches, right = true_points()
    low = [keypoints(squeezed_points(points.xy)) for points in (points0, points1)]
    found = CHECK.prepare(squeezed(pair), *low).estimate(matches)
    assert translation_error(found.T_1_0, pair.geometry.T_1_0) < 0.05
    assert rotation_error(found.T_1_0, pair.geometry.T_1_0) < 0.3
    assert found.inlier[~right].mean() < 0.05


def test_the_depth_of_image_1_is_seen_by_its_own_camera():
    """Image 1 is twice as large, and only it has depth."""
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, right = true_points()
    camera = Camera(np.array([[500.0, 0, 320.5], [0, 500, 240.5], [0, 0, 1]]), (640, 480))
    depth = np.repeat(np.repeat(pair.geometry.depth1, 2, 0), 2, 1)
    larger = replace(pair, geometry=replace(pair.geometry, camera1=camera, depth0=None, depth1=depth))
    found = CHECK.prepare(larger, points0, keypoints(points1.xy * 2 + 0.5)).estimate(matches)
    assert translation_error(found.T_1_0, pair.geometry.T_1_0) < 0.05
    assert found.inlier[right].mean() > 0.9

from dataclasses import replace

import cv2
import numpy as np
from stereo_scenes import CAMERA, StereoScene
from textured_scenes import ArraySequence, texture

from sips_lit.geometry.mirror import flip_camera
from sips_lit.geometry.point_depth import View, posed_views, transfer_to_view, views
from sips_lit.geometry.projection import sample_depth
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.pairs.sampler import read_pair
from sips_lit.train.augment import mirror_pair
from sips_lit.types import Camera

STEREO = StereoMatcher(max_disparity=64)
SCENE = StereoScene(3)


def corners(image: np.ndarray) -> np.ndarray:
    return cv2.goodFeaturesToTrack(image, 200, 1e-3, 6).reshape(-1, 2)


def test_stereo_gives_the_depth_of_both_images():
    pair = read_pair(SCENE, 0, 2)
    for view, index in zip(views(pair), (0, 2), strict=True):
        xy = corners(SCENE.frames[index])
        found, truth = view.depth_at(xy, STEREO), sample_depth(SCENE.depths[index], xy)
        relative = np.abs(found / truth - 1)
        assert view.has_depth
        assert np.isfinite(found).mean() > 0.6
        assert np.nanmedian(relative) < 0.01
        assert (relative > 0.1).sum() < 0.06 * np.isfinite(found).sum()


def test_a_depth_map_comes_first():
    left, right = SCENE.frames[0], SCENE.rights[0]
    flat = np.full(left.shape, 7, np.float32)
    view = View(left, CAMERA, flat, right, 0.4)
    assert view.depth_at(corners(left), STEREO).tolist() == [7.0] * len(corners(left))


def test_a_mirrored_pair_keeps_its_depths():
    pair = read_pair(SCENE, 0, 1)
    turned = mirror_pair(pair, True, True)
    xy = corners(SCENE.frames[0])
    width, height = CAMERA.size
    mirrored = [width - 1, height - 1] - xy
    straight, back = views(pair)[0].depth_at(xy, STEREO), views(turned)[0].depth_at(mirrored, STEREO)
    assert turned.geometry.baseline < 0
    np.testing.assert_array_equal(turned.geometry.camera0.matrix, flip_camera(CAMERA, True, True).matrix)
    # the smallest numerical difference can tip a decision, so not all points are the same
    same = np.isclose(back, straight, rtol=1e-3) | (np.isnan(back) & np.isnan(straight))
    assert same.mean() > 0.98


def test_augmented_images_are_not_what_depth_is_measured_in():
    pair = read_pair(SCENE, 0, 1)
    dark = type(pair)(**{**{f: getattr(pair, f) for f in pair.__slots__}, "image0": pair.image0 // 50})
    xy = corners(SCENE.frames[0])
    np.testing.assert_array_equal(views(dark)[0].depth_at(xy, STEREO), views(pair)[0].depth_at(xy, STEREO))


def test_the_horizontal_focal_length_counts():
    """A partner that sees everything 10 px further left: at 1 m of baseline depth is the focal length / 10."""
    image = texture(60, 120)
    camera = Camera(np.array([[50.0, 0, 60], [0, 200.0, 30], [0, 0, 1]]), (120, 60))
    view = View(image, camera, None, np.roll(image, -10, axis=1), 1.0)
    depth = view.depth_at(np.array([[60.0, 30], [80, 20]]), STEREO)
    np.testing.assert_allclose(depth, [5, 5], rtol=0.01)


def test_each_image_has_its_own():
    pair = read_pair(SCENE, 0, 2)
    depths = [np.full(image.shape, value, np.float32) for image, value in zip(pair.frames[::2], (1, 2), strict=True)]
    geometry = replace(pair.geometry, camera1=flip_camera(CAMERA, True, False), depth0=depths[0], depth1=depths[1])
    first, second = views(replace(pair, geometry=geometry))
    for view, image, camera, depth, right in (
        (first, pair.frames[0], CAMERA, depths[0], SCENE.rights[0]),
        (second, pair.frames[-1], geometry.camera1, depths[1], SCENE.rights[2]),
    ):
        assert view.image is image
        assert view.camera is camera
        assert view.depth is depth
        np.testing.assert_array_equal(view.right, right)


def test_without_anything_that_tells_depth():
    view = View(SCENE.frames[0], CAMERA, None, SCENE.rights[0], None)
    assert not view.has_depth
    assert np.isnan(view.depth_at(np.array([[50, 60], [70, 80]]), STEREO)).tolist() == [True, True]
    assert views(read_pair(ArraySequence(SCENE.frames), 0, 1)) is None


def test_posed_views_need_cameras_a_pose_and_any_depth():
    pair = read_pair(StereoScene(2, "depth"), 0, 1)
    view0, view1, T_1_0 = posed_views(pair)
    assert view0.depth is pair.geometry.depth0
    assert view1.depth is pair.geometry.depth1
    assert T_1_0 is pair.geometry.T_1_0
    assert posed_views(replace(pair, geometry=replace(pair.geometry, depth0=None))) is not None
    assert posed_views(replace(pair, geometry=replace(pair.geometry, depth0=None, depth1=None))) is None
    assert posed_views(replace(pair, geometry=replace(pair.geometry, T_1_0=None))) is None
    assert posed_views(replace(pair, geometry=None)) is None


def test_a_view_sees_what_is_inside_and_not_hidden():
    camera = Camera(np.array([[10.0, 0, 4], [0, 10, 4], [0, 0, 1]]), (9, 9))
    blank = np.zeros((9, 9), np.uint8)
    here = View(blank, camera, None, None, None)
    wall = np.full((9, 9), 2.0, np.float32)
    wall[:, 5] = 1.8  # hides what is behind by more than 5 %
    there = View(blank, camera, wall, None, None)
    T = np.eye(4)
    T[0, 3] = 0.2  # a pixel to the right, at 2 m
    xy, depth = np.array([[3.0, 4], [4, 4], [8, 4], [4, 4]]), np.array([2.0, 2, 2, np.nan])
    moved, visible = transfer_to_view(xy, depth, here, there, T, 0.05)
    np.testing.assert_allclose(moved, [[4, 4], [5, 4], [9, 4], [np.nan, np.nan]], atol=1e-12)
    assert visible.tolist() == [True, False, False, False]
    assert transfer_to_view(xy, depth, here, there, T, 0.11)[1].tolist() == [True, True, False, False]
    assert transfer_to_view(xy, depth, here, here, T, 0.05)[1].tolist() == [True, True, False, False]

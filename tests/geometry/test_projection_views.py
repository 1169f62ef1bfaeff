"""Views: what tells the depth of their points."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from stereo_scenes import CAMERA, StereoScene
from textured_scenes import ArraySequence, keypoints, texture

from sips_lit.geometry.image_changes import flip_camera
from sips_lit.geometry.projection import View, frame_view, posed_views, sample_depth, views
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.pairs.sampler import read_pair
from sips_lit.train.augment import mirror_pair
from sips_lit.types import Camera

DEPTH = np.arange(1, 13, dtype=np.float32).reshape(3, 4)  # 3 rows, 4 columns
STEREO = StereoMatcher(max_disparity=64)
SCENE = StereoScene(3)


@pytest.mark.parametrize(
    ("x", "y", "expected"),
    [(0, 0, 1), (3, 2, 12), (1.4, 0.6, 6), (-0.4, -0.4, 1), (3.4, 2.4, 12), (2.6, 1.0, 8)],
)
def test_the_nearest_pixel(x, y, expected):
    assert sample_depth(DEPTH, np.array([[x, y]])).tolist() == [expected]


@pytest.mark.parametrize(("x", "y"), [(-0.6, 1), (3.6, 1), (1, -0.6), (1, 2.6), (-1e6, 0), (99, 99)])
def test_outside_is_nan(x, y):
    assert np.isnan(sample_depth(DEPTH, np.array([[x, y]]))).all()


@pytest.mark.parametrize("value", [0, -1, np.nan, np.inf, -np.inf])
def test_what_is_no_depth_is_nan(value):
    depth = DEPTH.copy()
    depth[1, 2] = value
    sampled = sample_depth(depth, np.array([[2, 1], [1, 1]]))
    assert np.isnan(sampled[0])
    assert sampled[1] == 6


def test_integer_maps_and_no_points():
    assert sample_depth(np.array([[0, 1500]]), np.array([[0, 0], [1, 0]])).tolist()[1] == 1500
    assert sample_depth(DEPTH, np.zeros((0, 2))).shape == (0,)


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


@pytest.mark.parametrize("at", [0, 1])
def test_augmented_images_are_not_what_depth_is_measured_in(at):
    pair = read_pair(SCENE, 0, 1)
    dark = replace(pair, image0=pair.image0 // 50, image1=pair.image1 // 50)
    xy = corners(SCENE.frames[at])
    found = views(dark)[at].depth_at(xy, STEREO)
    assert np.isfinite(found).mean() > 0.6
    np.testing.assert_array_equal(found, views(pair)[at].depth_at(xy, STEREO))


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


def test_keypoints_may_bring_their_depth():
    view = View(SCENE.frames[0], CAMERA, np.full(SCENE.frames[0].shape, 7, np.float32), None, None)
    points = keypoints([[50, 60], [70, 80]])
    assert view.depth_of(points, STEREO).tolist() == [7, 7]
    assert view.depth_of(replace(points, depth=np.array([2.0, np.nan])), STEREO)[0] == 2


def test_a_view_tells_depth_where_any_point_may_have_one():
    empty = np.full((240, 320), np.nan, np.float32)
    view = View(SCENE.frames[0], CAMERA, empty, None, None)
    assert view.has_depth
    assert not view.tells_depth
    assert not replace(view, depth=np.zeros_like(empty)).tells_depth
    empty[3, 4] = 2
    assert view.tells_depth
    assert replace(view, depth=None, right=SCENE.rights[0], baseline=0.4).tells_depth
    assert not replace(view, depth=None).tells_depth


class Zooming(StereoScene):
    """Each frame has its own camera."""

    def camera(self, index):
        return Camera(CAMERA.matrix + index * np.diag([1.0, 2, 0]), CAMERA.size)


@pytest.mark.parametrize("tells", ["stereo", "depth", "nothing"])
def test_the_view_of_a_frame(tells):
    scene = Zooming(3, tells)
    for index in range(3):
        view = frame_view(scene, index)
        assert view.image is scene.frames[index]
        assert view.camera.matrix[1, 1] == CAMERA.matrix[1, 1] + 2 * index
        assert view.depth is (scene.depths[index] if tells == "depth" else None)
        assert view.right is (scene.rights[index] if tells == "stereo" else None)
        assert view.baseline == (0.4 if tells == "stereo" else None)
    assert frame_view(ArraySequence(scene.frames), 0) is None


@pytest.mark.parametrize("lacking", ["depth0", "depth1"])
def test_posed_views_with_depth_of_one_image(lacking):
    pair = read_pair(StereoScene(2, "depth"), 0, 1)
    assert posed_views(replace(pair, geometry=replace(pair.geometry, **{lacking: None}))) is not None

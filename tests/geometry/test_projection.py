from dataclasses import replace

import cv2
import numpy as np
import pytest
from homographies import homographies, points
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from stereo_scenes import CAMERA, StereoScene
from textured_scenes import ArraySequence, keypoints, texture

from sips_lit.geometry.image_changes import flip_camera
from sips_lit.geometry.projection import (
    View,
    apply_homography,
    frame_view,
    inside,
    posed_views,
    project,
    sample_depth,
    transfer,
    transfer_to_view,
    views,
)
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.pairs.sampler import read_pair
from sips_lit.train.augment import mirror_pair
from sips_lit.types import Camera

DEPTH = np.arange(1, 13, dtype=np.float32).reshape(3, 4)  # 3 rows, 4 columns
CAMERA0 = Camera(np.array([[400.0, 0, 320], [0, 410, 240], [0, 0, 1]]), (640, 480))
CAMERA1 = Camera(np.array([[300.0, 0, 200], [0, 290, 150], [0, 0, 1]]), (400, 300))
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


def random_pose(vector: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(vector[:3])[0]
    T[:3, 3] = vector[3:]
    return T


@given(arrays(float, 6, elements=st.floats(-0.4, 0.4)), st.integers(0, 100))
@settings(max_examples=50, deadline=None)
def test_pixels_of_known_points(pose, seed):
    T_1_0 = random_pose(pose)
    X0 = np.random.default_rng(seed).uniform([-1, -1, 3], [1, 1, 9], (20, 3))
    zero = np.zeros(3)
    xy0 = cv2.projectPoints(X0, zero, zero, CAMERA0.matrix, None)[0][:, 0]
    expected = cv2.projectPoints(X0, pose[:3], pose[3:], CAMERA1.matrix, None)[0][:, 0]
    moved, depth = transfer(xy0, X0[:, 2], CAMERA0, CAMERA1, T_1_0)
    np.testing.assert_allclose(moved, expected, atol=1e-6)
    np.testing.assert_allclose(depth, [(T_1_0 @ [*X, 1])[2] for X in X0])
    back, depth_back = transfer(moved, depth, CAMERA1, CAMERA0, np.linalg.inv(T_1_0))
    np.testing.assert_allclose(back, xy0, atol=1e-6)
    np.testing.assert_allclose(depth_back, X0[:, 2])


def test_what_is_in_front_projects_as_opencv_says_and_the_rest_is_nan():
    X = np.random.default_rng(0).uniform([-1, -1, 3], [1, 1, 9], (20, 3))
    expected = cv2.projectPoints(X, np.zeros(3), np.zeros(3), CAMERA0.matrix, None)[0][:, 0]
    np.testing.assert_allclose(project(X, CAMERA0), expected, atol=1e-9)
    assert np.isnan(project(-X, CAMERA0)).all()
    assert np.isnan(project(X * [1, 1, 0], CAMERA0)).all()
    assert np.isnan(project(np.full((2, 3), np.nan), CAMERA0)).all()


def test_points_behind_the_camera_are_nan():
    T_1_0 = np.eye(4)
    T_1_0[2, 3] = -5
    xy = np.full((3, 2), 100.0)
    moved, depth = transfer(xy, np.array([4.0, 5.0, 6.0]), CAMERA0, CAMERA0, T_1_0)
    assert np.isnan(moved[:2]).all()
    assert np.isnan(depth[:2]).all()
    assert depth[2] == 1


def test_unknown_depth_stays_unknown():
    moved, depth = transfer(np.array([[5.0, 5]]), np.array([np.nan]), CAMERA0, CAMERA1, np.eye(4))
    assert np.isnan(moved).all()
    assert np.isnan(depth).all()


def test_no_points():
    moved, depth = transfer(np.zeros((0, 2)), np.zeros(0), CAMERA0, CAMERA1, np.eye(4))
    assert moved.shape == (0, 2)
    assert depth.shape == (0,)


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


@given(homographies, points)
@settings(max_examples=60, deadline=None)
def test_there_and_back_by_a_homography(H, xy):
    there = apply_homography(H, xy)
    assert np.isfinite(there).all()
    np.testing.assert_allclose(apply_homography(np.linalg.inv(H), there), xy, atol=1e-6)


@given(homographies, points)
@settings(max_examples=40, deadline=None)
def test_a_homography_as_opencv(H, xy):
    expected = cv2.perspectiveTransform(xy[:, None], H)[:, 0]
    np.testing.assert_allclose(apply_homography(H, xy), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("sign", [1, -1, 0.1])
def test_points_beyond_the_horizon_are_nan(sign):
    H = sign * np.array([[1, 0, 0], [0, 1, 0], [-0.01, 0, 1]])
    mapped = apply_homography(H, np.array([[50.0, 10], [100, 10], [150, 10]]))
    np.testing.assert_allclose(mapped[0], [100, 20])
    assert np.isnan(mapped[1:]).all()


def test_no_points_by_a_homography():
    assert apply_homography(np.eye(3), np.zeros((0, 2))).shape == (0, 2)


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


def test_pixels_are_inside_up_to_their_outer_edges():
    xy = [[-0.5, -0.5], [3.5, 2.5], [1, 1], [-0.6, 1], [3.6, 1], [1, -0.6], [1, 2.6], [np.nan, 1]]
    assert inside(np.array(xy), (4, 3)).tolist() == [True] * 3 + [False] * 5


@pytest.mark.parametrize(("size", "seen"), [((40, 12), [True, True, False]), ((12, 40), [False, False, True])])
def test_the_border_is_that_of_the_other_view(size, seen):
    """Both cameras have one focal length and centre; the places are (30, 5), (11.6, 5) and (5, 30) in both."""
    matrix, xy = np.array([[10.0, 0, 0], [0, 10, 0], [0, 0, 1]]), np.array([[30, 5], [11.6, 5], [5, 30]])
    here, there = (View(np.zeros(s[::-1], np.uint8), Camera(matrix, s), None, None, None) for s in ((50, 50), size))
    moved, visible = transfer_to_view(xy, np.full(3, 2.0), here, there, np.eye(4), 0.05)
    np.testing.assert_allclose(moved, xy)
    assert visible.tolist() == seen
    back = transfer_to_view(xy, np.full(3, 2.0), there, here, np.eye(4), 0.05)[1]
    assert back.tolist() == [True] * 3


@pytest.mark.parametrize(("surface", "visible"), [(1.0, True), (0.96, True), (0.9, False), (2.0, True)])
def test_what_hides_a_point_is_nearer_to_the_other_camera(surface, visible):
    """A point 2 m ahead of a camera is 1 m ahead of one that went 1 m forward."""
    camera, T = Camera(np.array([[10.0, 0, 4], [0, 10, 4], [0, 0, 1]]), (9, 9)), np.eye(4)
    T[2, 3] = -1
    here = View(np.zeros((9, 9), np.uint8), camera, None, None, None)
    there = replace(here, depth=np.full((9, 9), surface, np.float32))
    assert transfer_to_view(np.array([[5.0, 4]]), np.array([2.0]), here, there, T, 0.05)[1].tolist() == [visible]


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

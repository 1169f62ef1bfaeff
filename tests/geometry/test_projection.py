from dataclasses import replace

import cv2
import numpy as np
import pytest
from homographies import homographies, points
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sips_lit.geometry.projection import View, apply_homography, inside, project, transfer, transfer_to_view
from sips_lit.types import Camera

CAMERA0 = Camera(np.array([[400.0, 0, 320], [0, 410, 240], [0, 0, 1]]), (640, 480))
CAMERA1 = Camera(np.array([[300.0, 0, 200], [0, 290, 150], [0, 0, 1]]), (400, 300))


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

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sips_lit.geometry.projection import inside, project, sample_depth, transfer
from sips_lit.types import Camera

DEPTH = np.arange(1, 13, dtype=np.float32).reshape(3, 4)  # 3 rows, 4 columns
CAMERA0 = Camera(np.array([[400.0, 0, 320], [0, 410, 240], [0, 0, 1]]), (640, 480))
CAMERA1 = Camera(np.array([[300.0, 0, 200], [0, 290, 150], [0, 0, 1]]), (400, 300))


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


def test_pixels_are_inside_up_to_their_outer_edges():
    xy = [[-0.5, -0.5], [3.5, 2.5], [1, 1], [-0.6, 1], [3.6, 1], [1, -0.6], [1, 2.6], [np.nan, 1]]
    assert inside(np.array(xy), (4, 3)).tolist() == [True] * 3 + [False] * 5

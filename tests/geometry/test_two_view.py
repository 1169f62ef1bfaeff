import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.geometry.pose import rotation_error
from sips_lit.geometry.projection import apply_homography, project
from sips_lit.geometry.two_view import epipolar_distance, fit_homography, fit_relative_pose
from sips_lit.types import Camera

CAMERA0 = Camera(np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), (640, 480))
CAMERA1 = Camera(np.array([[700.0, 4, 400], [0, 650, 300], [0, 0, 1]]), (800, 600))  # with skew
H = np.array([[1.1, 0.05, -12], [-0.03, 0.95, 8], [1e-4, -5e-5, 1]])
CORNERS = np.array([[0, 0], [639, 0], [639, 479], [0, 479]], float)


def moved(turn: tuple[float, float, float], t: tuple[float, float, float]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(np.array(turn, float))[0], t
    return T


def seen(T_1_0: np.ndarray, count: int = 80, seed: int = 0, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Points of a room in both cameras."""
    generator = np.random.default_rng(seed)
    points = generator.uniform([-3, -2, 4], [3, 2, 12], (count, 3))
    xy0, xy1 = project(points, CAMERA0), project(points @ T_1_0[:3, :3].T + T_1_0[:3, 3], CAMERA1)
    return xy0 + noise * generator.standard_normal(xy0.shape), xy1 + noise * generator.standard_normal(xy1.shape)


def planar(count: int = 60, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    xy0 = np.random.default_rng(seed).uniform([0, 0], [640, 480], (count, 2))
    return xy0, apply_homography(H, xy0)


def angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1))))


def test_the_homography_of_exact_matches_among_wrong_ones():
    xy0, xy1 = planar()
    xy1[::3] += np.random.default_rng(1).uniform(20, 60, (20, 2))
    found = fit_homography(xy0, xy1)
    assert np.abs(apply_homography(found.H, CORNERS) - apply_homography(H, CORNERS)).max() < 0.01
    np.testing.assert_array_equal(found.inlier, np.arange(60) % 3 != 0)


def test_an_inlier_lands_within_the_threshold():
    xy0, xy1 = planar()
    xy1 += np.random.default_rng(2).normal(0, 1.5, xy1.shape)
    for threshold in (1.0, 3.0):
        found = fit_homography(xy0, xy1, threshold)
        near = np.linalg.norm(cv2.perspectiveTransform(xy0[None], found.H)[0] - xy1, axis=1) <= threshold
        np.testing.assert_array_equal(found.inlier, near)
        assert 10 < near.sum() < 60


def test_no_homography():
    xy0, xy1 = planar()
    line = np.stack([np.arange(20.0), 2 * np.arange(20.0)], 1)
    mirror = np.stack([640 - xy0[:, 0], xy0[:, 1]], 1)
    for start, goal in [(xy0[:3], xy1[:3]), (xy0[:0], xy1[:0]), (line, line), (np.ones((9, 2)), np.ones((9, 2)))]:
        found = fit_homography(start, goal)
        assert found.H is None
        assert found.inlier.shape == (len(start),)
        assert not found.inlier.any()
    assert fit_homography(xy0, mirror).H is None
    assert fit_homography(xy0[:4], xy1[:4]).inlier.sum() == 4


@pytest.mark.parametrize("t", [(1.0, 0.1, 0.2), (0.0, 0.0, 1.0), (-0.5, -0.4, 0.0), (0.0, 0.0, -0.8)])
def test_the_pose_of_noisy_matches_among_wrong_ones(t):
    T = moved((0.05, -0.12, 0.03), t)
    xy0, xy1 = seen(T, noise=0.3)
    xy1[::4] = np.random.default_rng(1).uniform([0, 0], [800, 600], (20, 2))
    found = fit_relative_pose(xy0, xy1, CAMERA0, CAMERA1, threshold=2.0)
    assert rotation_error(found.T_1_0, T) < 0.3
    assert angle(found.T_1_0[:3, 3], T[:3, 3]) < 3
    assert np.linalg.norm(found.T_1_0[:3, 3]) == pytest.approx(1)
    assert found.inlier[np.arange(80) % 4 != 0].mean() > 0.95
    assert found.inlier[::4].mean() < 0.3


def test_swapped_columns_are_no_pose_of_this_scene():
    T = moved((0.05, -0.12, 0.03), (1, 0.1, 0.2))
    xy0, xy1 = seen(T)
    found = fit_relative_pose(xy0[:, ::-1], xy1, CAMERA0, CAMERA1)
    assert found.T_1_0 is None or found.inlier.mean() < 0.5 or rotation_error(found.T_1_0, T) > 10


def test_swapped_images_have_the_inverse_pose():
    T = moved((0.05, -0.12, 0.03), (1, 0.1, 0.2))
    xy0, xy1 = seen(T)
    found = fit_relative_pose(xy1, xy0, CAMERA1, CAMERA0).T_1_0
    assert rotation_error(found, np.linalg.inv(T)) < 1e-3
    assert angle(found[:3, 3], np.linalg.inv(T)[:3, 3]) < 1e-2


@pytest.mark.parametrize("turn", [(0, 0, 0), (0.02, 0.1, -0.3)])
def test_a_rotation_has_no_translation(turn):
    T = moved(turn, (0, 0, 0))
    xy0, xy1 = seen(T, noise=0.2)
    found = fit_relative_pose(xy0, xy1, CAMERA0, CAMERA1)
    assert rotation_error(found.T_1_0, T) < 0.1
    np.testing.assert_array_equal(found.T_1_0[:3, 3], 0)
    rays = np.column_stack([xy0, np.ones(len(xy0))]) @ np.linalg.inv(CAMERA0.matrix).T
    off = np.linalg.norm(project(rays @ found.T_1_0[:3, :3].T, CAMERA1) - xy1, axis=1)
    assert found.inlier[off <= 1].all()
    assert np.mean(off <= 1) > 0.9


def test_far_points_are_inliers_of_a_motion():
    """Noise puts half of them behind the cameras."""
    T = moved((0.01, 0.02, 0), (1, 0, 0))
    xy0, xy1 = seen(T, noise=0.3)
    far = np.random.default_rng(3).uniform([-3e4, -2e4, 4e4], [3e4, 2e4, 1e5], (40, 3))
    a, b = project(far, CAMERA0), project(far @ T[:3, :3].T + T[:3, 3], CAMERA1)
    noisy = b + np.random.default_rng(4).normal(0, 0.3, b.shape)
    found = fit_relative_pose(np.concatenate([xy0, a]), np.concatenate([xy1, noisy]), CAMERA0, CAMERA1)
    assert angle(found.T_1_0[:3, 3], T[:3, 3]) < 3
    assert found.inlier[80:].mean() > 0.95


def test_points_behind_the_cameras_are_no_inliers():
    T = moved((0, 0, 0), (1, 0, 0))
    xy0, xy1 = seen(T)
    wrong = xy0[:20], 2 * project(np.column_stack([xy0[:20], np.ones(20)]) @ np.linalg.inv(CAMERA0.matrix).T, CAMERA1)
    behind = wrong[1] - xy1[:20]  # moved the other way
    found = fit_relative_pose(np.concatenate([xy0, wrong[0]]), np.concatenate([xy1, behind]), CAMERA0, CAMERA1)
    assert found.inlier[:80].all()
    assert not found.inlier[80:].any()


def test_no_pose():
    xy0, xy1 = seen(moved((0.05, -0.12, 0.03), (1, 0.1, 0.2)))
    line = np.stack([np.arange(20.0), 2 * np.arange(20.0)], 1)
    for start, goal in [(xy0[:4], xy1[:4]), (xy0[:0], xy1[:0]), (line, line), (np.ones((9, 2)), np.ones((9, 2)))]:
        found = fit_relative_pose(start, goal, CAMERA0, CAMERA1)
        assert found.T_1_0 is None
        assert found.inlier.shape == (len(start),)
        assert not found.inlier.any()


def test_both_fits_give_the_same_again():
    xy0, xy1 = seen(moved((0.05, -0.12, 0.03), (1, 0.1, 0.2)), noise=1.0)
    cv2.setRNGSeed(3)
    first = fit_homography(xy0, xy1, 10).H, fit_relative_pose(xy0, xy1, CAMERA0, CAMERA1).T_1_0
    cv2.setRNGSeed(4)
    again = fit_homography(xy0, xy1, 10).H, fit_relative_pose(xy0, xy1, CAMERA0, CAMERA1).T_1_0
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], again[1])


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000))
def test_the_distance_is_that_of_opencv(seed):
    T = moved((0.05, -0.12, 0.03), (1, 0.1, 0.2))
    xy0, xy1 = seen(T, 6, seed, noise=5.0)
    x, y, z = T[:3, 3]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    F = np.linalg.inv(CAMERA1.matrix).T @ cross @ T[:3, :3] @ np.linalg.inv(CAMERA0.matrix)
    pairs = (np.append(a, 1).reshape(3, 1) for a in np.concatenate([xy0, xy1]))
    points = list(pairs)
    expected = [cv2.sampsonDistance(points[i], points[i + 6], F) for i in range(6)]
    np.testing.assert_allclose(epipolar_distance(xy0, xy1, CAMERA0, CAMERA1, T) ** 2, expected, rtol=1e-6)

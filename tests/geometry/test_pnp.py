import threading
import time
from types import SimpleNamespace

import cv2
import numpy as np
import poselib
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slow_ransac import most_inliers

from sips_lit.geometry.pnp import p3p_ransac
from sips_lit.geometry.pose import PoseEstimate, rotation_error, translation_error
from sips_lit.types import Camera

CAMERA = Camera(np.array([[400.0, 0.5, 320], [0, 410, 240], [0, 0, 1]]), (640, 480))
SQUARE = Camera(np.array([[400.0, 0, 320], [0, 400, 240], [0, 0, 1]]), (640, 480))
SKEWED = Camera(np.array([[400.0, 60, 300], [0, 550, 250], [0, 0, 1]]), (640, 480))


def correspondences(
    count: int, seed: int, noise: float = 0.0, outliers: float = 0.0, camera: Camera = CAMERA
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points (M, 3), pixels (M, 2), the true pose, and which are right (M,)."""
    generator = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(generator.uniform(-0.5, 0.5, 3))[0]
    T[:3, 3] = generator.uniform(-1, 1, 3)
    pixels = generator.uniform([0, 0], camera.size, (count, 2))
    seen = np.column_stack([pixels, np.ones(count)]) @ np.linalg.inv(camera.matrix).T
    seen *= generator.uniform(2, 40, (count, 1))
    points = (seen - T[:3, 3]) @ T[:3, :3]
    pixels += generator.normal(0, noise, (count, 2)) if noise else 0
    right = np.arange(count) >= round(outliers * count)
    pixels[~right] = generator.uniform([0, 0], camera.size, (int((~right).sum()), 2))
    return points, pixels, T, right


def estimate(points: np.ndarray, pixels: np.ndarray, seed: int = 0, **options: object) -> PoseEstimate:
    return p3p_ransac(points, pixels, CAMERA, np.random.default_rng(seed), **options)


def least_squares(points: np.ndarray, pixels: np.ndarray, camera: Camera, start: np.ndarray) -> np.ndarray:
    """OpenCV's pose (4, 4) with the smallest sum of squared errors in pixels."""
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-12)
    rotation, translation = cv2.Rodrigues(start[:3, :3])[0], start[:3, 3:].copy()
    rotation, translation = cv2.solvePnPRefineLM(points, pixels, camera.matrix, None, rotation, translation, stop)
    return np.vstack([np.column_stack([cv2.Rodrigues(rotation)[0], translation]), [0, 0, 0, 1]])


@given(st.integers(0, 10_000), st.integers(4, 40))
@settings(max_examples=20, deadline=None)
def test_perfect_correspondences_give_the_pose_exactly(seed, count):
    points, pixels, T, _ = correspondences(count, seed)
    found = estimate(points, pixels, iterations=200)
    assert found.inlier.all()
    if count > 5:  # the fourth point can be near another solution of the other three
        np.testing.assert_allclose(found.T_1_0, T, atol=1e-6)


def test_a_skewed_camera_with_two_focal_lengths():
    points, pixels, T, right = correspondences(60, 3, outliers=0.3, camera=SKEWED)
    found = p3p_ransac(points, pixels, SKEWED, np.random.default_rng(0))
    np.testing.assert_allclose(found.T_1_0, T, atol=1e-6)
    np.testing.assert_array_equal(found.inlier, right)


def test_only_what_is_within_the_threshold_counts_and_all_of_it():
    points, pixels, T, _ = correspondences(80, 6, camera=SQUARE)
    pixels[:20, 0] += 2
    wide, narrow = (
        p3p_ransac(points, pixels, SQUARE, np.random.default_rng(0), threshold=threshold) for threshold in (3.0, 1.0)
    )
    assert wide.inlier.all()
    expected = least_squares(points, pixels, SQUARE, T)
    np.testing.assert_allclose(wide.T_1_0, expected, atol=1e-6)
    assert np.abs(expected - T).max() > 1e-3
    assert narrow.inlier.tolist() == [False] * 20 + [True] * 60
    np.testing.assert_allclose(narrow.T_1_0, T, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_finds_the_inliers_among_seventy_per_cent_outliers(seed):
    points, pixels, T, right = correspondences(150, seed, noise=0.5, outliers=0.7)
    found = estimate(points, pixels)
    assert found.inlier[right].mean() > 0.97
    assert found.inlier[~right].sum() <= 3  # by chance
    assert translation_error(found.T_1_0, T) < 0.1
    assert rotation_error(found.T_1_0, T) < 0.3


@pytest.mark.parametrize("camera", [CAMERA, SKEWED])
def test_inliers_are_those_that_opencv_projects_within_the_threshold(camera):
    points, pixels, _, _ = correspondences(100, 5, noise=2.0, outliers=0.3, camera=camera)
    found = p3p_ransac(points, pixels, camera, np.random.default_rng(0), threshold=3.0)
    rotation = cv2.Rodrigues(found.T_1_0[:3, :3])[0]
    projected = cv2.projectPoints(points, rotation, found.T_1_0[:3, 3], camera.matrix, None)[0][:, 0]
    (_, skew, _), (_, focal, centre), _ = camera.matrix
    projected[:, 0] += skew * (projected[:, 1] - centre) / focal  # OpenCV knows no skew
    ahead = (points @ found.T_1_0[2, :3] + found.T_1_0[2, 3]) > 0
    expected = (np.linalg.norm(projected - pixels, axis=1) <= 3) & ahead
    np.testing.assert_array_equal(found.inlier, expected)
    assert 30 < found.inliers < 100


def test_as_many_inliers_as_opencv_finds():
    for seed in range(5):
        points, pixels, _, _ = correspondences(60, seed, noise=1.0, outliers=0.5)
        _, _, _, inliers = cv2.solvePnPRansac(  # a skew of half a pixel is too little to matter
            points, pixels, CAMERA.matrix, None, iterationsCount=3000, reprojectionError=3.0, flags=cv2.SOLVEPNP_P3P
        )
        assert estimate(points, pixels).inliers >= len(inliers) - 1


@pytest.mark.parametrize(("count", "outliers"), [(20, 0.4), (60, 0.5), (150, 0.7)])
def test_as_many_inliers_as_the_slow_twin(count, outliers):
    for seed in range(3):
        points, pixels, _, _ = correspondences(count, seed, noise=0.5, outliers=outliers)
        most = most_inliers(points, pixels, CAMERA.matrix, 1000, 3.0)
        assert estimate(points, pixels, iterations=1000).inliers >= most


@pytest.mark.parametrize("iterations", [1, 77, 3000])
def test_the_number_of_samples_is_exact_however_easy_the_problem(iterations, monkeypatch):
    told = []
    search = poselib.estimate_absolute_pose
    monkeypatch.setattr(poselib, "estimate_absolute_pose", lambda *args: told.append(search(*args)) or told[-1])
    points, pixels, _, _ = correspondences(50, 0)
    estimate(points, pixels, iterations=iterations)
    assert [information["iterations"] for _, information in told] == [iterations]


def test_points_behind_the_camera_are_no_inliers():
    points, pixels, T, _ = correspondences(30, 2)
    mirrored = points.copy()
    mirrored[:10] = (-(points[:10] @ T[:3, :3].T + T[:3, 3]) - T[:3, 3]) @ T[:3, :3]  # same pixels, behind
    found = estimate(mirrored, pixels)
    assert found.inlier.tolist() == [False] * 10 + [True] * 20


def test_refinement_does_not_lose_inliers_and_brings_the_pose_nearer():
    unrefined, refined = [], []
    for seed in range(5):
        points, pixels, T, right = correspondences(100, seed, noise=1.0, outliers=0.2)
        found = estimate(points, pixels)
        assert found.inlier[right].mean() > 0.9
        refined.append(translation_error(found.T_1_0, T))
        three = estimate(points[right][:4], pixels[right][:4])
        unrefined.append(translation_error(three.T_1_0, T))
    assert np.mean(refined) < np.mean(unrefined) / 2


def test_the_same_generator_gives_the_same_answer():
    points, pixels, _, _ = correspondences(40, 1, noise=2.0, outliers=0.6)
    first, again = estimate(points, pixels, seed=4), estimate(points, pixels, seed=4)
    np.testing.assert_array_equal(first.T_1_0, again.T_1_0)
    np.testing.assert_array_equal(first.inlier, again.inlier)
    others = [estimate(points, pixels, seed=seed, iterations=3).inliers for seed in range(12)]
    assert len(set(others)) > 1


@pytest.mark.parametrize("count", range(4))
def test_too_few_correspondences_are_no_pose(count):
    points, pixels, _, _ = correspondences(count, 0)
    found = estimate(points, pixels)
    assert found.T_1_0 is None
    assert found.inlier.tolist() == [False] * count
    assert found.inliers == 0


def test_points_on_a_line_are_no_pose():
    _, pixels, _, _ = correspondences(10, 0)
    line = np.column_stack([np.arange(10.0), np.zeros(10), np.full(10, 5.0)])
    assert estimate(line, pixels).T_1_0 is None
    assert estimate(np.zeros((10, 3)), pixels).T_1_0 is None


def test_points_on_a_line_that_fit_are_no_pose():
    for seed in (*range(50), 2982):  # the last one leads PoseLib 2.0.5 to one of the infinitely many poses
        generator = np.random.default_rng(seed)
        line = generator.uniform([-2, -2, 4], [2, 2, 9]) + np.linspace(-1, 1, 10)[:, None] * generator.normal(size=3)
        line = line[line[:, 2] > 0.5]
        projected = line @ CAMERA.matrix.T
        found = estimate(line, projected[:, :2] / projected[:, 2:], iterations=300)
        assert found.T_1_0 is None
        assert not found.inlier.any()


def test_outliers_do_not_make_up_for_inliers_on_a_line(monkeypatch):
    """The search is stood in for by the true pose, with which only the points of a line agree."""
    points, pixels, T, _ = correspondences(12, 0, outliers=0.5)
    along = np.linspace(3, 9, 6)[:, None] * [0.1, 0.05, 1] + [0.5, 0.2, 0]
    points[6:] = (along - T[:3, 3]) @ T[:3, :3]
    seen = along @ CAMERA.matrix.T
    pixels[6:] = seen[:, :2] / seen[:, 2:]
    monkeypatch.setattr("poselib.estimate_absolute_pose", lambda *_: (SimpleNamespace(Rt=T[:3]), {}))
    found = estimate(points, pixels)
    assert found.T_1_0 is None
    assert not found.inlier.any()
    points[11] += [0.1, 0, 0]
    seen = CAMERA.matrix @ (T[:3, :3] @ points[11] + T[:3, 3])
    pixels[11] = seen[:2] / seen[2]
    assert estimate(points, pixels).inlier.tolist() == [False] * 6 + [True] * 6


def test_other_threads_run_meanwhile():
    points, pixels, _, _ = correspondences(100, 0, noise=1.0, outliers=0.5)
    done = threading.Event()
    turns = []

    def count() -> None:
        while not done.is_set():
            turns.append(time.perf_counter())

    thread = threading.Thread(target=count)
    thread.start()
    start = time.perf_counter()
    estimate(points, pixels, iterations=100_000)  # some tenths of a second
    end = time.perf_counter()
    done.set()
    thread.join()
    # a call that holds the lock lets nobody in between its first and its last instant
    middle = [turn for turn in turns if 0.25 < (turn - start) / (end - start) < 0.75]
    assert len(middle) > 100


def test_the_search_measures_with_the_mean_of_both_focal_lengths(monkeypatch):
    told = []
    search = poselib.estimate_absolute_pose
    monkeypatch.setattr(poselib, "estimate_absolute_pose", lambda *args: told.append(args[3]) or search(*args))
    points, pixels, _, _ = correspondences(20, 0, camera=SKEWED)
    p3p_ransac(points, pixels, SKEWED, np.random.default_rng(0), threshold=3.0)
    assert told[0]["max_reproj_error"] == pytest.approx(3 / ((400 + 550) / 2))

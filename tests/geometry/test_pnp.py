import itertools

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.geometry.pnp import draw_triples, p3p_ransac
from sips_lit.geometry.pose import PoseEstimate, rotation_error, translation_error
from sips_lit.types import Camera

CAMERA = Camera(np.array([[400.0, 0.5, 320], [0, 410, 240], [0, 0, 1]]), (640, 480))


def correspondences(
    count: int, seed: int, noise: float = 0.0, outliers: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points (M, 3), pixels (M, 2), the true pose, and which are right (M,)."""
    generator = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(generator.uniform(-0.5, 0.5, 3))[0]
    T[:3, 3] = generator.uniform(-1, 1, 3)
    pixels = generator.uniform([0, 0], CAMERA.size, (count, 2))
    seen = np.column_stack([pixels, np.ones(count)]) @ np.linalg.inv(CAMERA.matrix).T
    seen *= generator.uniform(2, 40, (count, 1))
    points = (seen - T[:3, 3]) @ T[:3, :3]
    pixels += generator.normal(0, noise, (count, 2)) if noise else 0
    right = np.arange(count) >= round(outliers * count)
    pixels[~right] = generator.uniform([0, 0], CAMERA.size, (int((~right).sum()), 2))
    return points, pixels, T, right


def estimate(points: np.ndarray, pixels: np.ndarray, seed: int = 0, **options: object) -> PoseEstimate:
    return p3p_ransac(points, pixels, CAMERA, np.random.default_rng(seed), **options)


@given(st.integers(0, 10_000), st.integers(4, 40))
@settings(max_examples=20, deadline=None)
def test_perfect_correspondences_give_the_pose_exactly(seed, count):
    points, pixels, T, _ = correspondences(count, seed)
    found = estimate(points, pixels, iterations=200)
    assert found.inlier.all()
    if count > 5:  # the fourth point can be near another solution of the other three
        np.testing.assert_allclose(found.T_1_0, T, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_finds_the_inliers_among_seventy_per_cent_outliers(seed):
    points, pixels, T, right = correspondences(150, seed, noise=0.5, outliers=0.7)
    found = estimate(points, pixels)
    assert found.inlier[right].mean() > 0.97
    assert found.inlier[~right].sum() <= 3  # by chance
    assert translation_error(found.T_1_0, T) < 0.1
    assert rotation_error(found.T_1_0, T) < 0.3


def test_inliers_are_those_that_opencv_projects_within_the_threshold():
    points, pixels, _, _ = correspondences(100, 5, noise=2.0, outliers=0.3)
    found = estimate(points, pixels, threshold=3.0)
    rotation = cv2.Rodrigues(found.T_1_0[:3, :3])[0]
    projected = cv2.projectPoints(points, rotation, found.T_1_0[:3, 3], CAMERA.matrix, None)[0][:, 0]
    projected[:, 0] += 0.5 * (projected[:, 1] - 240) / 410  # OpenCV knows no skew
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


@given(st.integers(3, 9), st.integers(0, 100))
@settings(max_examples=20, deadline=None)
def test_triples_are_different_numbers(count, seed):
    triples = draw_triples(count, 300, np.random.default_rng(seed))
    assert triples.shape == (300, 3)
    assert triples.min() >= 0
    assert triples.max() < count
    assert (np.diff(np.sort(triples, 1), axis=1) > 0).all()


def test_all_triples_are_equally_likely():
    triples = draw_triples(5, 30_000, np.random.default_rng(0))
    kinds, counts = np.unique(triples, axis=0, return_counts=True)
    assert len(kinds) == len(list(itertools.permutations(range(5), 3)))
    assert np.abs(counts / 500 - 1).max() < 0.2

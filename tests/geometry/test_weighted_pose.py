import numpy as np
import pytest
import torch

from sips_lit.geometry.pose import rotation_error, to_rotation, translation_error
from sips_lit.geometry.projection import project
from sips_lit.geometry.weighted_pose import refine_pose
from sips_lit.types import Camera

CAMERA = Camera(np.array([[500, 3.0, 320], [0, 480, 240], [0, 0, 1]]), (640, 480))


def scene(seed: int, count: int = 40) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, the true pose, and one near it."""
    generator = np.random.default_rng(seed)
    points = generator.uniform([-2, -1.5, 4], [2, 1.5, 12], (count, 3))
    poses = []
    for size in (1.0, 1.3):
        T = np.eye(4)
        T[:3, :3] = to_rotation(np.array([[0.02, -0.03 * size, 0.01 * size, 1.0]]))[0]
        T[:3, 3] = [0.3 * size, -0.1, 0.2 * size]
        poses.append(T)
    return points, poses[0], poses[1]


def seen(points: np.ndarray, T: np.ndarray) -> np.ndarray:
    return project(points @ T[:3, :3].T + T[:3, 3], CAMERA)


def unequal(count: int, generator: np.random.Generator) -> np.ndarray:
    """Covariances of points that are sure or unsure, along x, along y, or along a diagonal."""
    sigma = np.exp(generator.uniform(np.log(0.1), np.log(3), (count, 2)))
    correlation = generator.uniform(-0.9, 0.9, count) * sigma.prod(1)
    return np.stack([sigma[:, 0] ** 2, correlation, correlation, sigma[:, 1] ** 2], 1).reshape(-1, 2, 2)


def test_without_noise_it_is_the_true_pose():
    points, truth, near = scene(0)
    found = refine_pose(near, points, seen(points, truth), np.tile(np.eye(2), (len(points), 1, 1)), CAMERA)
    np.testing.assert_allclose(found, truth, atol=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_minimum_that_scipy_finds(seed):
    optimize = pytest.importorskip("scipy.optimize", reason="scipy is missing: pip install scipy")
    points, truth, near = scene(seed)
    generator = np.random.default_rng(seed)
    covariance = unequal(len(points), generator)
    pixels = seen(points, truth) + np.array([generator.multivariate_normal([0, 0], one) for one in covariance])
    root = [np.linalg.cholesky(np.linalg.inv(one)).T for one in covariance]

    def pose_of(x: np.ndarray) -> np.ndarray:
        T = np.eye(4)
        w = torch.tensor([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]], dtype=torch.float64)
        T[:3, :3], T[:3, 3] = torch.matrix_exp(w).numpy(), x[3:]
        return T

    def residuals(x: np.ndarray) -> np.ndarray:
        return np.concatenate([r @ e for r, e in zip(root, seen(points, pose_of(x)) - pixels, strict=True)])

    expected = pose_of(
        optimize.least_squares(residuals, [0, 0, 0, 0.3, -0.1, 0.2], xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    )
    np.testing.assert_allclose(refine_pose(near, points, pixels, covariance, CAMERA), expected, atol=1e-6)


def errors(claim) -> tuple[float, float]:
    """Mean errors over 40 scenes of unequally sure points, whose covariances are said to be ``claim`` of the true ones."""
    rotation, translation = [], []
    for seed in range(40):
        generator = np.random.default_rng(seed)
        points, truth, near = scene(seed)
        covariance = unequal(len(points), generator)
        pixels = seen(points, truth) + np.array([generator.multivariate_normal([0, 0], one) for one in covariance])
        found = refine_pose(near, points, pixels, claim(covariance), CAMERA)
        rotation.append(rotation_error(found, truth))
        translation.append(translation_error(found, truth))
    return float(np.mean(rotation)), float(np.mean(translation))


def test_weights_help_where_points_are_not_equally_sure():
    weighted, equal = errors(lambda c: c), errors(lambda c: np.broadcast_to(np.eye(2), c.shape))
    assert weighted[0] < 0.5 * equal[0]
    assert weighted[1] < 0.5 * equal[1]
    swapped = errors(lambda c: c[:, ::-1, ::-1])
    assert weighted[0] < 0.5 * swapped[0]


def test_only_proportions_matter():
    points, truth, near = scene(5)
    generator = np.random.default_rng(5)
    covariance, pixels = unequal(len(points), generator), seen(points, truth) + generator.normal(0, 1, (len(points), 2))
    one, other = (refine_pose(near, points, pixels, factor * covariance, CAMERA) for factor in (1, 7.5))
    np.testing.assert_allclose(one, other, atol=1e-7)


def test_what_determines_no_pose_keeps_it():
    points, truth, near = scene(0, 2)
    np.testing.assert_array_equal(
        refine_pose(near, points, seen(points, truth), np.tile(np.eye(2), (2, 1, 1)), CAMERA), near
    )
    same = np.repeat(points[:1], 5, 0)
    found = refine_pose(near, same, seen(same, truth), np.tile(np.eye(2), (5, 1, 1)), CAMERA)
    assert np.isfinite(found).all()

"""A pose refined on its inliers, each reprojection error weighted by the covariance that its pixel claims.

Generalised least squares: residuals whitened by the covariance, Gauss-Newton on the motion (Hartley and Zisserman, Multiple
View Geometry, A6.2.1 and A6.3).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.geometry.projection import project
from sips_lit.types import Camera, FloatArray

STEPS: Final = 20
_CONVERGED: Final = 1e-10  # relative change of the cost


def refine_pose(
    T: FloatArray, points: FloatArray, pixels: FloatArray, covariance: FloatArray, camera: Camera
) -> NDArray[np.float64]:
    """The pose (4, 4) near ``T`` with the least sum of squared Mahalanobis distances of M reprojection errors.

    ``points`` (M, 3) in frame 0, ``pixels`` (M, 2) in the ``camera`` of frame 1, all finite; ``covariance`` (M, 2, 2) of the
    pixels, of which only the proportions matter. ``T`` itself where no step makes it better: fewer than three points, say.
    """
    pose = np.array(T, np.float64)
    X, xy = np.asarray(points, np.float64), np.asarray(pixels, np.float64)
    if len(X) < 3:
        return pose
    whitening = np.linalg.inv(np.linalg.cholesky(np.asarray(covariance, np.float64)))
    cost = _cost(pose, X, xy, whitening, camera)
    damping = 1e-6
    for _ in range(STEPS):
        residual, jacobian = _linearised(pose, X, xy, whitening, camera)
        normal = jacobian.T @ jacobian
        step = np.linalg.lstsq(normal + damping * np.diag(np.diag(normal)), -jacobian.T @ residual, rcond=None)[0]
        moved = _moved(pose, np.asarray(step, np.float64))
        new = _cost(moved, X, xy, whitening, camera)
        if not new < cost:  # a point behind the camera makes it NaN
            damping *= 100
            continue
        converged, pose, cost, damping = cost - new <= _CONVERGED * cost, moved, new, damping / 10
        if converged:
            break
    return pose


def _cost(
    pose: NDArray[np.float64], X: NDArray[np.float64], xy: NDArray[np.float64], whitening: FloatArray, camera: Camera
) -> float:
    errors = project(X @ pose[:3, :3].T + pose[:3, 3], camera) - xy
    return float((np.einsum("mij,mj->mi", whitening, errors) ** 2).sum())


def _linearised(
    pose: NDArray[np.float64], X: NDArray[np.float64], xy: NDArray[np.float64], whitening: FloatArray, camera: Camera
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Whitened residuals (2 M,) and their derivatives (2 M, 6) by a rotation vector and a shift in frame 1."""
    there = X @ pose[:3, :3].T + pose[:3, 3]
    errors = project(there, camera) - xy
    depth = there[:, 2]
    K = camera.matrix
    by_point = np.zeros((len(X), 2, 3))  # d pixel / d point in frame 1; K may have skew
    by_point[:, :, :2] = K[:2, :2] / depth[:, None, None]
    by_point[:, :, 2] = -(there[:, :2] @ K[:2, :2].T) / depth[:, None] ** 2
    x, y, z = there.T
    zero = np.zeros_like(x)
    by_rotation = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], 1).reshape(-1, 3, 3)  # d point: -[point]x
    whitened = whitening @ np.concatenate([by_point @ by_rotation, by_point], 2)
    return np.einsum("mij,mj->mi", whitening, errors).ravel(), whitened.reshape(-1, 6)


def _moved(pose: NDArray[np.float64], step: NDArray[np.float64]) -> NDArray[np.float64]:
    """The pose after a small rotation (by Rodrigues' formula) and a shift in frame 1."""
    angle = float(np.linalg.norm(step[:3]))
    x, y, z = step[:3] / angle if angle > 0 else (1.0, 0.0, 0.0)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    moved = np.eye(4)
    moved[:3, :3], moved[:3, 3] = rotation @ pose[:3, :3], rotation @ pose[:3, 3] + step[3:]
    return moved

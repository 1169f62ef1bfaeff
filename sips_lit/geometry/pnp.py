"""P3P in RANSAC: the pose of a camera from points in space and their pixels, of which many are wrong (paper, pose).

OpenCV's RANSAC stops early and ignores seeds; here the number of samples is exact and the randomness an argument.
"""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.geometry.p3p import solve_p3p
from sips_lit.geometry.pose import PoseEstimate
from sips_lit.types import Camera, FloatArray

_CONVERGED: Final = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 1e-12)
"""Steps at most, and a relative change: by default OpenCV stops a micrometre and some 1e-6 degrees early."""
_CHUNK: Final = 256  # poses scored at a time: their errors stay in the processor's cache


def p3p_ransac(
    points: FloatArray,
    pixels: FloatArray,
    camera: Camera,
    generator: np.random.Generator,
    iterations: int = 3000,
    threshold: float = 3.0,
) -> PoseEstimate:
    """The pose with the largest inlier set among those of ``iterations`` random minimal samples.

    ``points`` (M, 3) in frame 0, ``pixels`` (M, 2) in the ``camera`` of frame 1; an inlier is in front of the camera and
    projects within ``threshold`` pixels. A degenerate sample counts as an iteration. The winner is refined on its inliers
    (Levenberg-Marquardt), unless that loses any. No pose without four correspondences, or where no three agree.
    """
    count = len(points)
    none = PoseEstimate(None, np.zeros(count, np.bool_))
    if count < 4:
        return none
    X, xy = np.asarray(points, np.float64), np.asarray(pixels, np.float64)
    rays = np.column_stack([xy, np.ones(count)]) @ np.linalg.inv(camera.matrix).T
    # Triples of few points repeat, and a repeated sample can't give another pose.
    samples = np.sort(draw_triples(count, iterations, generator), axis=1)
    samples = samples[np.unique(samples @ [count * count, count, 1], return_index=True)[1]]
    poses, _ = solve_p3p(X[samples], rays[samples])
    if not len(poses):
        return none
    best = poses[int(_inlier_counts(poses, X, xy, camera, threshold).argmax())]
    inlier = _agrees(best, X, xy, camera, threshold)
    refined = _refined(best, X[inlier], rays[inlier], camera)
    agrees = _agrees(refined, X, xy, camera, threshold)
    if agrees.sum() >= inlier.sum():
        best, inlier = refined, agrees
    return PoseEstimate(np.vstack([best, [0, 0, 0, 1]]), inlier) if inlier.sum() >= 3 else none


def draw_triples(count: int, samples: int, generator: np.random.Generator) -> NDArray[np.int64]:
    """(samples, 3) numbers below ``count``, three different ones each, all triples equally likely."""
    first, second, third = (generator.integers(0, count - taken, samples) for taken in range(3))
    second = second + (second >= first)
    low, high = np.minimum(first, second), np.maximum(first, second)
    third = third + (third >= low)
    third = third + (third >= high)
    return np.column_stack([first, second, third])


def _inlier_counts(
    poses: NDArray[np.float64], X: NDArray[np.float64], xy: NDArray[np.float64], camera: Camera, threshold: float
) -> NDArray[np.int64]:
    """How many points (M, 3) each of the poses (P, 3, 4) projects within ``threshold`` of their pixels, (P,).

    (K P X)_x - x z is linear in the pose, so the errors times the depth of all points under all poses are two matrix
    products, without a division.
    """
    homogeneous = np.column_stack([X, np.ones(len(X))])
    projections = np.asarray(camera.matrix, np.float64) @ poses
    lines = projections.astype(np.float32)
    # (8, M): multiplied with the rows (projection's x or y, projection's z) these give the error
    along_x = np.concatenate([homogeneous.T, -homogeneous.T * xy[:, 0]]).astype(np.float32)
    along_y = np.concatenate([homogeneous.T, -homogeneous.T * xy[:, 1]]).astype(np.float32)
    to_depth = (threshold * homogeneous.T).astype(np.float32)
    counts = np.empty(len(poses), np.int64)
    for begin in range(0, len(poses), _CHUNK):
        part = lines[begin : begin + _CHUNK]
        x = part[:, [0, 2]].reshape(-1, 8) @ along_x
        y = part[:, [1, 2]].reshape(-1, 8) @ along_y
        allowed = part[:, 2] @ to_depth
        x *= x
        y *= y
        x += y
        y = allowed * allowed
        counts[begin : begin + _CHUNK] = np.count_nonzero((x <= y) & (allowed > 0), axis=1)
    return counts


def _agrees(
    pose: NDArray[np.float64], X: NDArray[np.float64], xy: NDArray[np.float64], camera: Camera, threshold: float
) -> NDArray[np.bool_]:
    """The same for one pose (3, 4), in full precision: which points (M,)."""
    projected = (X @ pose[:, :3].T + pose[:, 3]) @ np.asarray(camera.matrix, np.float64).T
    with np.errstate(divide="ignore", invalid="ignore"):
        near = np.linalg.norm(projected[:, :2] / projected[:, 2:] - xy, axis=1) <= threshold
    return np.asarray(near & (projected[:, 2] > 0), np.bool_)


def _refined(
    pose: NDArray[np.float64], X: NDArray[np.float64], rays: NDArray[np.float64], camera: Camera
) -> NDArray[np.float64]:
    if len(X) < 4:  # three points determine the pose: nothing to refine
        return pose
    undistorted: Any = None
    # OpenCV knows no skew: pixels of a camera without it, and with its principal point at 0
    focal = np.array([camera.matrix[0, 0], camera.matrix[1, 1]], np.float64)
    xy, K, start = rays[:, :2] * focal, np.diag([*focal, 1.0]), cv2.Rodrigues(pose[:, :3])[0]
    rotation, translation = cv2.solvePnPRefineLM(X, xy, K, undistorted, start, pose[:, 3:].copy(), _CONVERGED)
    return np.column_stack([cv2.Rodrigues(rotation)[0], translation])

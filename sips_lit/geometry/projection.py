"""From a pixel with depth in one view to its pixel in another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import Camera, FloatArray


def sample_depth(depth: FloatArray, xy: FloatArray) -> NDArray[np.float64]:
    """Depth (N,) of the pixel nearest to each point (N, 2); NaN outside the map (H, W) and where it is not positive.

    Nearest, not interpolated: a mean of foreground and background lies on neither.
    """
    column, row = np.round(np.asarray(xy, np.float64)).astype(np.int64).T
    inside = (column >= 0) & (row >= 0) & (column < depth.shape[1]) & (row < depth.shape[0])
    sampled = np.full(len(column), np.nan)
    sampled[inside] = depth[row[inside], column[inside]]
    with np.errstate(invalid="ignore"):
        sampled[~(sampled > 0) | ~np.isfinite(sampled)] = np.nan
    return sampled


def back_project(xy: FloatArray, depth: FloatArray, camera: Camera) -> NDArray[np.float64]:
    """Points (N, 3) in the camera's frame that are seen at N pixels (N, 2) with depths (N,); NaN where it is NaN."""
    homogeneous = np.column_stack([xy, np.ones(len(xy))]).astype(np.float64)
    points: NDArray[np.float64] = (np.linalg.solve(camera.matrix, homogeneous.T) * depth).T
    return points


def project(points: FloatArray, camera: Camera) -> NDArray[np.float64]:
    """Pixels (N, 2) of points (N, 3) in the camera's frame; NaN where they are not in front of it."""
    projected = np.asarray(points @ camera.matrix.T, np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(points[:, 2:] > 0, projected[:, :2] / projected[:, 2:], np.nan)


def inside(xy: FloatArray, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Which of N pixels (N, 2) are in an image of ``size`` (W, H), whose pixels reach from -0.5 to W - 0.5; not NaN ones."""
    with np.errstate(invalid="ignore"):
        within: NDArray[np.bool_] = np.all((xy >= -0.5) & (xy <= np.array(size) - 0.5), axis=1)
    return within


def transfer(
    xy: FloatArray, depth: FloatArray, camera_from: Camera, camera_to: Camera, T_to_from: FloatArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pixels (N, 2) and depths (N,) in the other view of N pixels (N, 2) with depths (N,); NaN where behind the camera."""
    points = back_project(xy, depth, camera_from) @ T_to_from[:3, :3].T + T_to_from[:3, 3]
    return project(points, camera_to), np.where(points[:, 2] > 0, points[:, 2], np.nan)

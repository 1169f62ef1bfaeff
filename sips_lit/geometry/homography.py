"""Plane homographies in pixel coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import FloatArray


def apply_homography(H: FloatArray, xy: FloatArray) -> NDArray[np.float64]:
    """Points (N, 2) mapped by a homography (3, 3); NaN where a point goes behind the plane at infinity."""
    mapped = np.column_stack([xy, np.ones(len(xy))]).astype(np.float64) @ np.asarray(H, np.float64).T
    depth = mapped[:, 2:] / np.linalg.det(H) ** (1 / 3) if np.linalg.det(H) > 0 else mapped[:, 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(depth > 0, mapped[:, :2] / mapped[:, 2:], np.nan)


def flip_homography(H: FloatArray, size: tuple[int, int], horizontal: bool, vertical: bool) -> NDArray[np.float64]:
    """The homography between two images (W, H) after both were mirrored."""
    width, height = size
    mirror = np.diag([-1.0 if horizontal else 1.0, -1.0 if vertical else 1.0, 1.0])
    mirror[0, 2] = width - 1 if horizontal else 0
    mirror[1, 2] = height - 1 if vertical else 0
    flipped: NDArray[np.float64] = mirror @ np.asarray(H, np.float64) @ mirror
    return flipped

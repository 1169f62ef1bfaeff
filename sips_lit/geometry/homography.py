"""Plane homographies in pixel coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import FloatArray


def apply_homography(H: FloatArray, xy: FloatArray) -> NDArray[np.float64]:
    """Points (N, 2) mapped by a homography (3, 3); NaN where a point goes behind the other camera.

    H preserves orientation, as between two photographs of the same side of a plane: its sign is then that of its
    determinant, and a point is in front of the camera where the third coordinate has the same sign.
    """
    mapped = np.column_stack([xy, np.ones(len(xy))]).astype(np.float64) @ np.asarray(H, np.float64).T
    in_front = mapped[:, 2:] * np.sign(np.linalg.det(H)) > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(in_front, mapped[:, :2] / mapped[:, 2:], np.nan)


def flip_homography(
    H: FloatArray, size0: tuple[int, int], size1: tuple[int, int], horizontal: bool, vertical: bool
) -> NDArray[np.float64]:
    """The homography from image 0 to image 1, of sizes (W, H), after both were mirrored."""
    mirror0, mirror1 = (_mirror(size, horizontal, vertical) for size in (size0, size1))
    flipped: NDArray[np.float64] = mirror1 @ np.asarray(H, np.float64) @ mirror0  # a mirror is its own inverse
    return flipped


def _mirror(size: tuple[int, int], horizontal: bool, vertical: bool) -> NDArray[np.float64]:
    width, height = size
    mirror = np.diag([-1.0 if horizontal else 1.0, -1.0 if vertical else 1.0, 1.0])
    mirror[0, 2] = width - 1 if horizontal else 0
    mirror[1, 2] = height - 1 if vertical else 0
    return mirror

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

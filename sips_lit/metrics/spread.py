"""Spread: whether the inliers of an image lie all over it, which poses need, or in one place."""

from __future__ import annotations

import numpy as np

from sips_lit.types import FloatArray


def spread(xy: FloatArray, size: tuple[int, int], cells: int = 8) -> float:
    """Fraction of the ``cells`` x ``cells`` equal cells of an image of ``size`` (W, H) that hold one of (N, 2) points.

    A cell has its left and upper edges; pixels reach from -0.5 to W - 0.5. Points outside count to the nearest cell.
    """
    if not len(xy):
        return 0.0
    place = (np.asarray(xy, np.float64) + 0.5) / np.array(size) * cells
    cell = np.clip(np.floor(place).astype(np.int64), 0, cells - 1)
    return len(np.unique(cell, axis=0)) / cells**2

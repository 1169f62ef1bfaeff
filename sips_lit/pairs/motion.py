"""How the points of an image have moved in another: how far, by which turn and zoom."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def motion_of(
    xy0: NDArray[np.complex128], xy1: NDArray[np.complex128], counts: NDArray[np.int64]
) -> NDArray[np.float16]:
    """Motion (R, 3) from R images to another: of the first ``counts`` (R,) points of each row.

    ``xy0`` (R, N) are the places x + iy in the R images, ``xy1`` (N,) those in the other; beyond the counts they may be NaN.
    The columns: median distance in pixels; turn in degrees (positive from x to y) and binary logarithm of the zoom of the
    similarity that fits best by least squares. All are 0 for no points.
    """
    counted = np.arange(xy0.shape[1]) < counts[:, None]
    distances = np.sort(np.where(counted, abs(xy1 - xy0), np.inf), 1)
    moved = np.take_along_axis(distances, np.maximum(counts - 1, 0)[:, None] // 2, 1)[:, 0] if xy0.size else counts
    p, q = (np.where(counted, xy, 0) for xy in (xy0, np.broadcast_to(xy1, xy0.shape)))
    p = np.where(counted, p - (p.sum(1) / np.maximum(1, counts))[:, None], 0)
    spread = (abs(p) ** 2).sum(1)
    similarity = np.where(spread > 0, (q * p.conj()).sum(1) / np.where(spread > 0, spread, 1), 1)
    zoom = np.log2(np.clip(abs(similarity), 1e-3, 1e3))
    return np.stack([np.where(counts > 0, moved, 0), np.degrees(np.angle(similarity)), zoom], 1).astype(np.float16)


def as_complex(xy: NDArray[Any]) -> NDArray[np.complex128]:
    """Places x + iy (N,) of points (N, 2)."""
    return xy[:, 0].astype(np.float64) + 1j * xy[:, 1]

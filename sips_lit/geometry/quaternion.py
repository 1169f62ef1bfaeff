"""Unit quaternions as rotations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import FloatArray


def to_rotation(quaternion: FloatArray) -> NDArray[np.float64]:
    """Rotation matrices (N, 3, 3) of quaternions (N, 4) in the order x, y, z, w; their length does not matter.

    NaN for a quaternion of length 0.
    """
    q = np.asarray(quaternion, np.float64)
    with np.errstate(invalid="ignore"):
        x, y, z, w = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)

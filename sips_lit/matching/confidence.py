"""How sure a match is, from what its two points and their descriptors tell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import FloatArray, Matches


def shared_probability(score0: FloatArray, score1: FloatArray) -> NDArray[np.float32]:
    """The probability (M,) of M matches from those of their points, (M,) each, of being inliers: the geometric mean.

    Both points are inliers or neither is, so the two tell of one event; their product would be too low (our choice).
    """
    return np.sqrt(np.asarray(score0, np.float32) * np.asarray(score1, np.float32))


def distinctness(distances: FloatArray, matches: Matches) -> NDArray[np.float32]:
    """How much nearer the partner of M matches is than the second nearest: 1 - d1 / d2 (M,), of the worse side.

    From 0 (as near) to 1: an order, no probability. Lowe's ratio (2004, section 7.1) of `distances` (N0, N1), squared ones.
    0 where a side has no second point to compare with.
    """
    nearest = distances[matches.index0, matches.index1]
    second = np.minimum(_second(distances)[matches.index0], _second(distances.T)[matches.index1])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(second > 0, nearest / second, 1)
    return np.asarray(1 - ratio, np.float32)


def _second(distances: FloatArray) -> NDArray[np.float32]:
    """The second least of each row (N0,)."""
    if distances.shape[1] < 2:
        return np.zeros(len(distances), np.float32)
    return np.asarray(np.partition(distances, 1, axis=1)[:, 1], np.float32)

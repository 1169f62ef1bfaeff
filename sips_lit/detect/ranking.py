"""The one order of points: best score first, ties by row, then column."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import Keypoints


def ranked(xy: NDArray[Any], score: NDArray[Any], n: int) -> NDArray[np.int64]:
    """Indices of the at most ``n`` best points: score descending, ties by row, then column, then as given."""
    return np.lexsort((xy[:, 0], xy[:, 1], -score))[: max(n, 0)]


def best_keypoints(xy: NDArray[Any], score: NDArray[Any], scale: NDArray[Any], n: int) -> Keypoints:
    """The at most ``n`` best of the points ``xy`` (N, 2) with ``score`` (N,) and ``scale`` (N,), sorted."""
    xy, score, scale = (np.asarray(values, np.float32) for values in (xy, score, scale))
    best = ranked(xy, score, n)
    return Keypoints(xy[best], score[best], scale[best])

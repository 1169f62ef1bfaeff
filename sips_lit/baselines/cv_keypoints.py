"""From the points of OpenCV's detectors to `Keypoints`: one order and one cut for all baselines."""

from __future__ import annotations

from collections.abc import Sequence
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


def positions(points: Sequence[Any]) -> NDArray[np.float64]:
    """(N, 2): where ``cv2.KeyPoint`` objects say they are."""
    return np.array([point.pt for point in points], np.float64).reshape(-1, 2)


def attribute(points: Sequence[Any], name: str) -> NDArray[np.float64]:
    """(N,): one attribute (``response``, ``size``, ``octave``, …) of ``cv2.KeyPoint`` objects."""
    return np.array([getattr(point, name) for point in points], np.float64)

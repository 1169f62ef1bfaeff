"""What detectors share: what they are unless they say otherwise, and the one order of points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import Features, FloatArray, GreyImage, Keypoints, ScoreKind


class BaseDetector:
    """Base of detectors: a subclass sets ``name`` and defines ``detect`` (see `sips_lit.types.Detector`)."""

    name: str
    describes: bool = False
    scores: ScoreKind = "order"

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points, best first: those of `detect_and_describe`."""
        return self.detect_and_describe(image, n).keypoints

    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """Raises TypeError: there is no descriptor."""
        raise TypeError(f"{self.name} has no descriptor of its own: detect points, then describe them")

    def best(self, keypoints: Keypoints, n: int) -> Keypoints:
        """The first ``n`` points as they are."""
        return keypoints.best(n)

    def score_map(self, image: GreyImage) -> FloatArray | None:
        """None: there is no map."""
        return None


def ranked(xy: NDArray[Any], score: NDArray[Any], n: int) -> NDArray[np.int64]:
    """Indices of the at most ``n`` best points: score descending, ties by row, then column, then as given."""
    return np.lexsort((xy[:, 0], xy[:, 1], -score))[: max(n, 0)]


def best_keypoints(
    xy: NDArray[Any], score: NDArray[Any], scale: NDArray[Any], n: int
) -> tuple[Keypoints, NDArray[np.int64]]:
    """The at most ``n`` best of the points ``xy`` (N, 2) with ``score`` (N,) and ``scale`` (N,), and their indices (M,)."""
    xy, score, scale = (np.asarray(values, np.float32) for values in (xy, score, scale))
    best = ranked(xy, score, n)
    return Keypoints(xy[best], score[best], scale[best]), best

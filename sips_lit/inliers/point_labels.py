"""From verified matches to labelled points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import Inliers, Reason


@dataclass(frozen=True, slots=True)
class PointLabels:
    """For the N selected points of one image: ``inlier`` (N,), ``known`` (N,) bool and ``reason`` (N,) uint8 (`Reason`).

    A point is an inlier if its match is one; every other point is an outlier, matched or not, unless nothing is known.
    """

    inlier: NDArray[np.bool_]
    known: NDArray[np.bool_]
    reason: NDArray[np.uint8]


def point_labels(inliers: Inliers, point_of_match: NDArray[np.int64], known: NDArray[np.bool_]) -> PointLabels:
    """Labels of the points of one image from what is known about their matches."""
    reason = np.where(known, Reason.UNMATCHED, Reason.UNKNOWN).astype(np.uint8)
    reason[point_of_match] = inliers.reason
    return PointLabels(reason == Reason.INLIER, reason != Reason.UNKNOWN, reason)

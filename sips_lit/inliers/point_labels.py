"""From matches verified in both directions to one answer for each, and to labelled points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import Inliers, Matches, Reason


def symmetric(
    forward: NDArray[np.uint8],
    backward: NDArray[np.uint8],
    matches: Matches,
    known0: NDArray[np.bool_],
    known1: NDArray[np.bool_],
) -> Inliers:
    """A match is an inlier if both directions say so; where one does not know (`Reason`) the other decides alone.

    ``forward`` and ``backward`` (M,) are the reasons from image 0 to 1 and from image 1 to 0; ``known0`` (N0,) and
    ``known1`` (N1,) tell which points have a depth of their own. A point without one is known through a match that is.
    """
    reason = np.where(forward == Reason.UNKNOWN, backward, forward)
    agreed = (forward == Reason.INLIER) & (backward != Reason.UNKNOWN)
    reason[agreed] = backward[agreed]
    decided = reason != Reason.UNKNOWN
    known0, known1 = known0.copy(), known1.copy()
    known0[matches.index0[decided]] = True
    known1[matches.index1[decided]] = True
    return Inliers(reason == Reason.INLIER, reason, known0, known1)


@dataclass(frozen=True, slots=True)
class PointLabels:
    """For the N selected points of one image: ``inlier`` (N,), ``known`` (N,) bool and ``reason`` (N,) uint8 (`Reason`).

    A point is an inlier if its match is one; every other point is an outlier, matched or not, unless nothing is known.
    ``share`` (N,) float32 is how much of an inlier it is: 1 or 0, if it is judged among one number of points only.
    ``residual`` (N, 2) float32: from its matched point to where it truly moves in the other image, (x, y) in pixels of
    that, NaN where it is no inlier; None where the check does not measure it.
    """

    inlier: NDArray[np.bool_]
    known: NDArray[np.bool_]
    reason: NDArray[np.uint8]
    share: NDArray[np.float32]
    residual: NDArray[np.float32] | None = None


def point_labels(
    inliers: Inliers, point_of_match: NDArray[np.int64], known: NDArray[np.bool_], way: int = 0
) -> PointLabels:
    """Labels of the points of one image, image 0 or 1 by ``way``, from what is known about their matches."""
    reason = np.where(known, Reason.UNMATCHED, Reason.UNKNOWN).astype(np.uint8)
    reason[point_of_match] = inliers.reason
    inlier = reason == Reason.INLIER
    residual = None
    if inliers.residual is not None:
        residual = np.full((len(known), 2), np.nan, np.float32)
        residual[point_of_match[inliers.inlier]] = inliers.residual[inliers.inlier, way]
    return PointLabels(inlier, reason != Reason.UNKNOWN, reason, inlier.astype(np.float32), residual)

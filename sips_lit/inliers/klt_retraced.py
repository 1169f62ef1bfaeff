"""Inliers by KLT in half the time: the track back retraces the track forth (our choice)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sips_lit.inliers.independent import IndependentCheck
from sips_lit.tracking.both_ways import SMALL_MOTION, follow, retrace
from sips_lit.tracking.klt import KltTracker
from sips_lit.types import FramePair, Inliers, Keypoints, Matches, Reason


@dataclass(frozen=True, slots=True)
class RetracedKltInliers(IndependentCheck):
    """As `KltInliers`, by `follow` and `retrace`: at least 0.995 of the labels are the same (`benchmarks/label_time.py`)."""

    tracker: KltTracker = field(default_factory=KltTracker)
    threshold: float = 3.0
    uses_frames: ClassVar[bool] = True

    @property
    def protocol(self) -> Mapping[str, Any]:
        """Method and thresholds."""
        return {
            "inliers": "klt_retraced",
            "threshold": self.threshold,
            "retraced_below": SMALL_MOTION,
            **self.tracker.parameters,
        }

    def __call__(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints, matches: Matches) -> Inliers:
        """Every point is known to KLT: what can't be tracked is an outlier."""
        points, point_of_match = np.unique(matches.index0, return_inverse=True)
        start, goal = keypoints0.xy[matches.index0], keypoints1.xy[matches.index1]
        tracks = follow(self.tracker, pair.frames, keypoints0.xy[points])
        residual = np.full((len(matches), 2, 2), np.nan, np.float32)
        residual[:, 0] = tracks.ends[point_of_match] - goal
        reason = self._judged(residual[:, 0], tracks.survived[point_of_match])
        forward = np.flatnonzero(reason == Reason.INLIER)  # the way back can only take inliers away
        moves = tracks.moves[::-1, point_of_match[forward]]
        ends, survived = retrace(self.tracker, pair.frames[::-1], goal[forward], moves)
        residual[forward, 1] = ends - start[forward]
        reason[forward] = self._judged(residual[forward, 1], survived)
        everything = (np.ones(len(keypoints0), np.bool_), np.ones(len(keypoints1), np.bool_))
        return Inliers(reason == Reason.INLIER, reason, *everything, residual)

    def _judged(self, residual: NDArray[np.float32], survived: NDArray[np.bool_]) -> NDArray[np.uint8]:
        """Reason (M,) of matches whose tracks, if they survived, end a residual (M, 2) away."""
        with np.errstate(invalid="ignore"):
            near = (residual**2).sum(1) <= self.threshold**2
        reason = np.where(near, Reason.INLIER, Reason.FAR).astype(np.uint8)
        reason[~survived] = Reason.LOST
        return reason

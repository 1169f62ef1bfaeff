"""Inliers by KLT: the match agrees with forward and backward tracks through all intermediate frames (paper, labels)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sips_lit.inliers.independent import IndependentCheck
from sips_lit.tracking.klt import KltTracker
from sips_lit.types import FramePair, Inliers, Keypoints, Matches, Reason


@dataclass(frozen=True, slots=True)
class KltInliers(IndependentCheck):
    """A match (i, j) is an inlier if the track of i ends within ``threshold`` pixels of j, and that of j near i."""

    tracker: KltTracker = field(default_factory=KltTracker)
    threshold: float = 3.0
    uses_frames: ClassVar[bool] = True

    @property
    def protocol(self) -> Mapping[str, Any]:
        """Method and thresholds."""
        return {"inliers": "klt", "threshold": self.threshold, **self.tracker.parameters}

    def __call__(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints, matches: Matches) -> Inliers:
        """Every point is known to KLT: what can't be tracked is an outlier."""
        reason, residual = self._one_way(pair.frames, keypoints0, keypoints1, matches)
        both = np.full((len(matches), 2, 2), np.nan, np.float32)
        both[:, 0] = residual
        forward = np.flatnonzero(reason == Reason.INLIER)  # tracking backward can only take inliers away
        turned = Matches(matches.index1[forward], matches.index0[forward])
        reason[forward], both[forward, 1] = self._one_way(pair.frames[::-1], keypoints1, keypoints0, turned)
        everything = (np.ones(len(keypoints0), np.bool_), np.ones(len(keypoints1), np.bool_))
        return Inliers(reason == Reason.INLIER, reason, *everything, both)

    def _one_way(
        self, frames: tuple[Any, ...], start: Keypoints, goal: Keypoints, matches: Matches
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Reason and residual (M, 2) of each match when its first point is tracked from the first frame to the last."""
        points, point_of_match = np.unique(matches.index0, return_inverse=True)
        ends, survived = self.tracker.track(frames, start.xy[points])
        residual = ends[point_of_match] - goal.xy[matches.index1]
        return self._judged(residual, survived[point_of_match]), residual

    def _judged(self, residual: NDArray[np.float32], survived: NDArray[np.bool_]) -> NDArray[np.uint8]:
        """Reason (M,) of matches whose tracks, if they survived, end a residual (M, 2) away."""
        with np.errstate(invalid="ignore"):
            near = (residual**2).sum(1) <= self.threshold**2
        reason = np.where(near, Reason.INLIER, Reason.FAR).astype(np.uint8)
        reason[~survived] = Reason.LOST
        return reason

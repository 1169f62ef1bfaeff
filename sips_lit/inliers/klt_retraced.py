"""Inliers by KLT in half the time: the track back retraces the track forth (our choice)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sips_lit.inliers.klt import KltInliers
from sips_lit.tracking.both_ways import MOST, NEAR, SMALL_MOTION, STEADY, follow, retrace
from sips_lit.types import FramePair, Inliers, Keypoints, Matches, Reason


class RetracedKltInliers(KltInliers):
    """As `KltInliers`, by `follow` and `retrace`: at least 0.995 of the labels are the same (`benchmarks/label_time.py`)."""

    __slots__ = ()

    @property
    def protocol(self) -> Mapping[str, Any]:
        """Method and thresholds."""
        own = {"retraced_below": SMALL_MOTION, "steady_within": STEADY, "found_within": NEAR, "most": MOST}
        return {**super().protocol, "inliers": "klt_retraced", **own}

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

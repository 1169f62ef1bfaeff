"""Inliers by true pose and depth (RGB-D, lidar, stereo ground truth)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.geometry.projection import sample_depth, transfer
from sips_lit.types import Camera, FloatArray, FramePair, Inliers, Keypoints, Matches, Reason


@dataclass(frozen=True, slots=True)
class PoseDepthInliers:
    """A match is an inlier if each point, moved to the other view with its depth, ends within ``threshold`` pixels.

    Where only one of the two depths is known that one decides; where neither is, the match is ignored. A point is hidden,
    and its match lost, if the other view's depth there is smaller than its own by more than ``occlusion`` (relative).
    """

    threshold: float = 3.0
    occlusion: float = 0.05
    independent: ClassVar[bool] = True
    uses_frames: ClassVar[bool] = False
    uses_depth: ClassVar[bool] = True

    @property
    def protocol(self) -> Mapping[str, Any]:
        """Method and thresholds."""
        return {"inliers": "pose_depth", "threshold": self.threshold, "occlusion": self.occlusion}

    def __call__(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints, matches: Matches) -> Inliers:
        """Raises BadInputError for a pair without pose, camera and depth."""
        g = pair.geometry
        if g is None or g.T_1_0 is None or (g.depth0 is None and g.depth1 is None):
            raise BadInputError(
                f"{pair.name} has no pose, camera and depth: choose another source of inliers, such as inliers=klt"
            )
        points0, points1 = keypoints0.xy[matches.index0], keypoints1.xy[matches.index1]
        forth = self._one_way(points0, points1, g.depth0, g.depth1, g.camera0, g.camera1, g.T_1_0)
        back = self._one_way(points1, points0, g.depth1, g.depth0, g.camera1, g.camera0, np.linalg.inv(g.T_1_0))
        known0, known1 = _known(g.depth0, keypoints0), _known(g.depth1, keypoints1)
        reason = np.where(forth == Reason.UNKNOWN, back, forth)
        both = (forth != Reason.UNKNOWN) & (back != Reason.UNKNOWN)
        reason[both & (forth == Reason.INLIER)] = back[both & (forth == Reason.INLIER)]
        # a point without a depth of its own is known through a match that the other side's depth decides
        decided = reason != Reason.UNKNOWN
        known0[matches.index0[decided]] = True
        known1[matches.index1[decided]] = True
        return Inliers(reason == Reason.INLIER, reason, known0, known1)

    def _one_way(
        self,
        start: FloatArray,
        goal: FloatArray,
        depth_start: FloatArray | None,
        depth_goal: FloatArray | None,
        camera_start: Camera,
        camera_goal: Camera,
        T_goal_start: FloatArray,
    ) -> NDArray[np.uint8]:
        if depth_start is None:
            return np.full(len(start), Reason.UNKNOWN, np.uint8)
        own = sample_depth(depth_start, start)
        moved, depth = transfer(start, own, camera_start, camera_goal, T_goal_start)
        width, height = camera_goal.size
        with np.errstate(invalid="ignore"):
            near = np.linalg.norm(moved - goal, axis=1) <= self.threshold
            lost = ~((moved >= -0.5) & (moved <= [width - 0.5, height - 0.5])).all(1)
            if depth_goal is not None:
                there = sample_depth(depth_goal, np.where(np.isfinite(moved), moved, -10))
                lost |= there < depth * (1 - self.occlusion)
        reason = np.where(near, Reason.INLIER, Reason.FAR).astype(np.uint8)
        reason[lost] = Reason.LOST
        reason[~np.isfinite(own)] = Reason.UNKNOWN
        return reason


def _known(depth: FloatArray | None, keypoints: Keypoints) -> NDArray[np.bool_]:
    if depth is None:
        return np.zeros(len(keypoints), np.bool_)
    return np.isfinite(sample_depth(depth, keypoints.xy))

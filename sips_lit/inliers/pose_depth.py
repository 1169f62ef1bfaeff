"""Inliers by true pose and depth (RGB-D, lidar, stereo ground truth)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.geometry.projection import View, sample_depth, transfer, views
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.inliers.symmetric import symmetric
from sips_lit.types import DisparityMatcher, FloatArray, FramePair, Inliers, Keypoints, Matches, Reason


@dataclass(frozen=True, slots=True)
class PoseDepthInliers:
    """A match is an inlier if each point, moved to the other view with its depth, ends within ``threshold`` pixels.

    The depth is that of the depth map or, where there is none, of matching the stereo partner. Where only one of the two
    depths is known that one decides; where neither is, the match is ignored. A point is hidden, and its match lost, if the
    other view's depth map there is smaller than its own by more than ``occlusion`` (relative). Stereo gives depth at points
    only, so there what is hidden is found by the other point's depth alone: it moves elsewhere.
    """

    threshold: float = 3.0
    occlusion: float = 0.05
    stereo: DisparityMatcher = field(default_factory=StereoMatcher)
    independent: ClassVar[bool] = True
    uses_frames: ClassVar[bool] = False
    uses_depth: ClassVar[bool] = True

    @property
    def protocol(self) -> Mapping[str, Any]:
        """Method and thresholds."""
        return {
            "inliers": "pose_depth",
            "threshold": self.threshold,
            "occlusion": self.occlusion,
            "stereo": dict(self.stereo.parameters),
        }

    def prepare(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints) -> PreparedPoseDepth:
        """Depth of all points. Raises BadInputError for a pair without pose, camera and depth."""
        both, T_1_0 = views(pair), None if pair.geometry is None else pair.geometry.T_1_0
        if both is None or T_1_0 is None or not (both[0].has_depth or both[1].has_depth):
            raise BadInputError(
                f"{pair.name} has no pose, camera and depth: choose another source of inliers, such as inliers=klt"
            )
        own0, own1 = both[0].depth_of(keypoints0, self.stereo), both[1].depth_of(keypoints1, self.stereo)
        return PreparedPoseDepth(self, both, T_1_0, (keypoints0.xy, keypoints1.xy), (own0, own1))

    def __call__(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints, matches: Matches) -> Inliers:
        """Raises BadInputError for a pair without pose, camera and depth."""
        return self.prepare(pair, keypoints0, keypoints1)(matches)


@dataclass(frozen=True, slots=True)
class PreparedPoseDepth:
    """The check for one pair and its points: pixels ``xy`` (N, 2) and depths ``own`` (N,) of each image."""

    check: PoseDepthInliers
    views: tuple[View, View]
    T_1_0: FloatArray
    xy: tuple[NDArray[np.float32], NDArray[np.float32]]
    own: tuple[NDArray[np.float64], NDArray[np.float64]]

    def __call__(self, matches: Matches, repeat: int = 0) -> Inliers:
        """Verifies M matches."""
        points = self.xy[0][matches.index0], self.xy[1][matches.index1]
        own = self.own[0][matches.index0], self.own[1][matches.index1]
        forward = self._one_way(points[0], own[0], points[1], *self.views, self.T_1_0)
        backward = self._one_way(points[1], own[1], points[0], *self.views[::-1], np.linalg.inv(self.T_1_0))
        return symmetric(forward, backward, matches, np.isfinite(self.own[0]), np.isfinite(self.own[1]))

    def _one_way(
        self,
        start: FloatArray,
        own: NDArray[np.float64],
        goal: FloatArray,
        view_start: View,
        view_goal: View,
        T_goal_start: FloatArray,
    ) -> NDArray[np.uint8]:
        moved, depth = transfer(start, own, view_start.camera, view_goal.camera, T_goal_start)
        width, height = view_goal.camera.size
        with np.errstate(invalid="ignore"):
            near = np.linalg.norm(moved - goal, axis=1) <= self.check.threshold
            lost = ~((moved >= -0.5) & (moved <= [width - 0.5, height - 0.5])).all(1)
            if view_goal.depth is not None:
                there = sample_depth(view_goal.depth, np.where(np.isfinite(moved), moved, -10))
                lost |= there < depth * (1 - self.check.occlusion)
        reason = np.where(near, Reason.INLIER, Reason.FAR).astype(np.uint8)
        reason[lost] = Reason.LOST
        reason[~np.isfinite(own)] = Reason.UNKNOWN
        return reason

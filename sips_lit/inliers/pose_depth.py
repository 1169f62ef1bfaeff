"""Inliers by true pose and depth (RGB-D, lidar, stereo ground truth)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.geometry.projection import View, posed_views, transfer_to_view
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.inliers.independent import IndependentCheck
from sips_lit.inliers.point_labels import symmetric
from sips_lit.types import DisparityMatcher, FloatArray, FramePair, Inliers, Keypoints, Matches, PreparedCheck, Reason


@dataclass(frozen=True, slots=True)
class PoseDepthInliers(IndependentCheck):
    """A match is an inlier if each point, moved to the other view with its depth, ends within ``threshold`` pixels.

    The depth is that of the depth map or, where there is none, of matching the stereo partner. Where only one of the two
    depths is known that one decides; where neither is, the match is ignored. A point is hidden, and its match lost, if the
    other view's depth map there is smaller than its own by more than ``occlusion`` (relative). Stereo gives depth at points
    only, so there what is hidden is found by the other point's depth alone: it moves elsewhere.
    """

    threshold: float = 3.0
    occlusion: float = 0.05
    stereo: DisparityMatcher = field(default_factory=StereoMatcher)
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

    def prepare(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints) -> PreparedCheck:
        """Depth of all points. Raises BadInputError for a pair without pose, camera and depth."""
        posed = posed_views(pair)
        if posed is None:
            raise BadInputError(
                f"{pair.name} has no pose, camera and depth: choose another source of inliers, such as inliers=klt"
            )
        view0, view1, T_1_0 = posed
        depth0, depth1 = view0.depth_of(keypoints0, self.stereo), view1.depth_of(keypoints1, self.stereo)

        def prepared(matches: Matches, repeat: int = 0) -> Inliers:
            xy0, xy1 = keypoints0.xy[matches.index0], keypoints1.xy[matches.index1]
            forward, ahead = self._one_way(xy0, depth0[matches.index0], xy1, view0, view1, T_1_0)
            backward, back = self._one_way(xy1, depth1[matches.index1], xy0, view1, view0, np.linalg.inv(T_1_0))
            answer = symmetric(forward, backward, matches, np.isfinite(depth0), np.isfinite(depth1))
            return replace(answer, residual=np.stack([ahead, back], 1).astype(np.float32))

        return prepared

    def __call__(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints, matches: Matches) -> Inliers:
        """Raises BadInputError for a pair without pose, camera and depth."""
        return self.prepare(pair, keypoints0, keypoints1)(matches)

    def _one_way(
        self, xy: FloatArray, depth: FloatArray, goal: FloatArray, here: View, there: View, T_there_here: FloatArray
    ) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
        """Reason and residual (M, 2) of matches: points ``xy`` (M, 2) with ``depth`` (M,) should move to ``goal`` (M, 2)."""
        moved, visible = transfer_to_view(xy, depth, here, there, T_there_here, self.occlusion)
        with np.errstate(invalid="ignore"):
            near = np.linalg.norm(moved - goal, axis=1) <= self.threshold
        seen = np.where(visible, np.where(near, Reason.INLIER, Reason.FAR), Reason.LOST)
        return np.where(np.isfinite(depth), seen, Reason.UNKNOWN).astype(np.uint8), moved - goal

"""The error of the relative pose that the matches of a pair give (paper, pose)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from sips_lit.geometry.point_depth import views
from sips_lit.geometry.pose import rotation_error, translation_error
from sips_lit.inliers.stereo_p3p import PreparedStereoP3P, StereoP3PInliers
from sips_lit.types import FloatArray, FramePair, Keypoints, Matches


@dataclass(frozen=True, slots=True)
class PairPose:
    """Estimates the pose of a pair by P3P in RANSAC, ``estimator``, and compares it with the true ``T_1_0``."""

    estimator: PreparedStereoP3P
    T_1_0: FloatArray

    def errors(self, matches: Matches, repeat: int, least: int = 0) -> tuple[float, float]:
        """Rotation error (degrees) and translation error (metres); infinite without a pose of ``least`` inliers."""
        estimate = for_repeat(self.estimator, repeat).estimate(matches)
        if estimate.T_1_0 is None or estimate.inliers < least:
            return math.inf, math.inf
        return rotation_error(estimate.T_1_0, self.T_1_0), translation_error(estimate.T_1_0, self.T_1_0)


def for_repeat(prepared: PreparedStereoP3P, repeat: int) -> PreparedStereoP3P:
    """The same, with the random samples of a repeat."""
    return replace(prepared, check=prepared.check.with_seed(prepared.check.seed + repeat))


def pair_pose(
    pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints, check: StereoP3PInliers
) -> PairPose | None:
    """What estimates the pose of a pair; None where the true one is not known, or nothing tells the depth of any point."""
    both, T_1_0 = views(pair), None if pair.geometry is None else pair.geometry.T_1_0
    if both is None or T_1_0 is None or not (both[0].has_depth or both[1].has_depth):
        return None
    return PairPose(check.prepare(pair, keypoints0, keypoints1), T_1_0)

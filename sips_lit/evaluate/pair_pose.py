"""The error of the relative pose that the matches of a pair give (paper, pose)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from sips_lit.geometry.point_depth import posed_views
from sips_lit.geometry.pose import rotation_error, translation_error
from sips_lit.inliers.stereo_p3p import PreparedStereoP3P, StereoP3PInliers
from sips_lit.types import FloatArray, FramePair, Keypoints, Matches


class PoseOutcome(IntEnum):
    """What became of the pose of a pair."""

    FOUND = 0
    UNKNOWN = 1
    """Not estimated: the true pose is not known, or the depth of no point is."""
    FEW_MATCHES = 2
    """Fewer than the four matches with a depth that P3P with RANSAC takes."""
    NO_AGREEMENT = 3
    """RANSAC finds no pose that three matches agree with."""
    FEW_INLIERS = 4
    """A pose with fewer inliers than a pose at a budget needs."""


class PoseErrors(NamedTuple):
    """Errors in degrees and metres, infinite where no pose was found."""

    rotation: float
    translation: float
    outcome: PoseOutcome


@dataclass(frozen=True, slots=True)
class PairPose:
    """Estimates the pose of a pair by P3P in RANSAC, ``estimator``, and compares it with the true ``T_1_0``."""

    estimator: PreparedStereoP3P
    T_1_0: FloatArray

    def errors(self, matches: Matches, repeat: int, least: int = 0) -> PoseErrors:
        """How far the pose of the matches is from the true one; infinitely without a pose of ``least`` inliers."""
        if self.estimator.usable(matches) < 4:
            return PoseErrors(math.inf, math.inf, PoseOutcome.FEW_MATCHES)
        estimate = self.estimator.estimate(matches, repeat)
        if estimate.T_1_0 is None:
            return PoseErrors(math.inf, math.inf, PoseOutcome.NO_AGREEMENT)
        if estimate.inliers < least:
            return PoseErrors(math.inf, math.inf, PoseOutcome.FEW_INLIERS)
        errors = rotation_error(estimate.T_1_0, self.T_1_0), translation_error(estimate.T_1_0, self.T_1_0)
        return PoseErrors(*errors, PoseOutcome.FOUND)


def pair_pose(
    pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints, check: StereoP3PInliers
) -> PairPose | None:
    """What estimates the pose of a pair; None where the true one is not known, or nothing tells the depth of any point."""
    posed = posed_views(pair)
    return None if posed is None else PairPose(check.prepare(pair, keypoints0, keypoints1), posed[2])

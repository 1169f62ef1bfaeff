"""Inliers by an estimated pose: 3-D points of one image, P3P in LO-RANSAC in the other (paper, labels from stereo; pose)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.geometry.pnp import ESTIMATOR, p3p_ransac
from sips_lit.geometry.pose import PoseEstimate
from sips_lit.geometry.projection import back_project, views
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.geometry.weighted_pose import refine_pose
from sips_lit.inliers.point_labels import symmetric
from sips_lit.types import Camera, DisparityMatcher, FloatArray, FramePair, Inliers, Keypoints, Matches, Reason

PoseWeights = Literal["none", "equal", "covariance"]
"""How the inliers weigh in the refinement of a pose: none refines nothing."""


@dataclass(frozen=True, slots=True)
class StereoP3PInliers:
    """A match is an inlier if it agrees with a pose estimated from all matches, in both directions.

    The points of image 0 with a depth (map or stereo partner) are points in space: P3P in image 1, exactly ``iterations``
    samples, inliers within ``threshold`` pixels. Then the same from image 1 to image 0. Where only one point of a match has
    a depth its way decides; where neither has, the match is ignored. True poses are not needed. The samples depend on
    ``seed``, the pair and the number of matches only.
    """

    threshold: float = 3.0
    iterations: int = 3000
    seed: int = 0
    stereo: DisparityMatcher = field(default_factory=StereoMatcher)
    independent: ClassVar[bool] = False
    uses_frames: ClassVar[bool] = False
    uses_depth: ClassVar[bool] = True

    @property
    def protocol(self) -> Mapping[str, Any]:
        """Method and thresholds."""
        return {
            "inliers": "stereo_p3p",
            "estimator": ESTIMATOR,
            "threshold": self.threshold,
            "iterations": self.iterations,
            "seed": self.seed,
            "stereo": dict(self.stereo.parameters),
        }

    def prepare(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints) -> PreparedStereoP3P:
        """Depth of all points. Raises BadInputError for a pair without a camera or without any depth."""
        both = views(pair)
        if both is None or not (both[0].has_depth or both[1].has_depth):
            raise BadInputError(
                f"{pair.name} has no depth maps and no stereo partners with cameras and a baseline, which "
                "inliers=stereo_p3p needs: use data that has them (kitti, euroc, rgbd, posed_depth) or choose inliers=klt"
            )
        side0, side1 = (
            _Side(k.xy, back_project(k.xy, v.depth_of(k, self.stereo), v.camera), v.camera, v.has_depth, k.covariance)
            for v, k in zip(both, (keypoints0, keypoints1), strict=True)
        )
        return PreparedStereoP3P(self, (pair.index0, pair.index1), (side0, side1))

    def __call__(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints, matches: Matches) -> Inliers:
        """Raises BadInputError for a pair without a camera or without any depth."""
        return self.prepare(pair, keypoints0, keypoints1)(matches)


@dataclass(frozen=True, slots=True)
class _Side:
    """The N points of one image: pixels (N, 2), in space (N, 3) with NaN where unknown, camera, covariance of the pixels."""

    xy: NDArray[np.float32]
    points: NDArray[np.float64]
    camera: Camera
    has_depth: bool
    covariance: NDArray[np.float32] | None

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which points have a depth (N,)."""
        return np.asarray(np.isfinite(self.points).all(1), np.bool_)


@dataclass(frozen=True, slots=True)
class PreparedStereoP3P:
    """The check for one pair and its points, whose depths are known: verifies any matches between them."""

    check: StereoP3PInliers
    indices: tuple[int, int]
    sides: tuple[_Side, _Side]

    def __call__(self, matches: Matches, repeat: int = 0) -> Inliers:
        """Verifies M matches, with other random samples for each ``repeat``."""
        known0, known1 = self.sides[0].known, self.sides[1].known
        forward = _reasons(self._one_way(0, matches, repeat), known0[matches.index0])
        backward = _reasons(self._one_way(1, matches, repeat), known1[matches.index1])
        return symmetric(forward, backward, matches, known0, known1)

    def usable(self, matches: Matches) -> int:
        """How many of the M matches have the depth that `estimate` needs."""
        side0, side1 = self.sides
        known = side0.known[matches.index0] if side0.has_depth else side1.known[matches.index1]
        return int(known.sum())

    def estimate(self, matches: Matches, repeat: int = 0) -> PoseEstimate:
        """The pose and which of the M matches agree with it, with other random samples for each ``repeat``.

        As in the paper one way: with 3-D points of image 0 if it has depth, else of image 1 (the pose is then inverted).
        """
        if self.sides[0].has_depth:
            return self._one_way(0, matches, repeat)
        backward = self._one_way(1, matches, repeat)
        T_1_0 = None if backward.T_1_0 is None else np.linalg.inv(backward.T_1_0).astype(np.float64)
        return PoseEstimate(T_1_0, backward.inlier)

    def refined(self, estimate: PoseEstimate, matches: Matches, weights: PoseWeights) -> PoseEstimate:
        """An estimate of these M matches, refined on those that agree with it; as it is with ``weights`` none.

        With ``covariance`` each match weighs by the sum of the covariances of both its pixels (the depth counts as exact,
        and the motion between the images as a shift), with ``equal``, or without covariances, all weigh the same.
        """
        if weights == "none" or estimate.T_1_0 is None:
            return estimate
        way = 0 if self.sides[0].has_depth else 1
        start, goal = self.sides[way], self.sides[1 - way]
        index_start, index_goal = _from_to(way, matches)
        index_start, index_goal = index_start[estimate.inlier], index_goal[estimate.inlier]
        claimed: FloatArray = np.broadcast_to(np.eye(2), (len(index_start), 2, 2))
        if weights == "covariance" and start.covariance is not None and goal.covariance is not None:
            claimed = start.covariance[index_start] + goal.covariance[index_goal]
        given = estimate.T_1_0 if way == 0 else np.linalg.inv(estimate.T_1_0)
        refined = refine_pose(given, start.points[index_start], goal.xy[index_goal], claimed, goal.camera)
        return replace(estimate, T_1_0=refined if way == 0 else np.linalg.inv(refined).astype(np.float64))

    def _one_way(self, way: int, matches: Matches, repeat: int) -> PoseEstimate:
        """Pose of the other camera in the frame of image ``way`` (0, 1); a match without depth there is no inlier."""
        start, goal = self.sides[way], self.sides[1 - way]
        index_start, index_goal = _from_to(way, matches)
        has_depth = np.flatnonzero(start.known[index_start])
        # a number that is never 0 comes last: numpy ignores trailing zeros of a seed
        generator = np.random.default_rng([self.check.seed + repeat, *self.indices, len(matches), way + 1])
        estimate = p3p_ransac(
            start.points[index_start[has_depth]],
            goal.xy[index_goal[has_depth]],
            goal.camera,
            generator,
            self.check.iterations,
            self.check.threshold,
        )
        inlier = np.zeros(len(matches), np.bool_)
        inlier[has_depth] = estimate.inlier
        return PoseEstimate(estimate.T_1_0, inlier)


def _from_to(way: int, matches: Matches) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The matched points in image ``way`` and in the other."""
    return (matches.index0, matches.index1) if way == 0 else (matches.index1, matches.index0)


def _reasons(estimate: PoseEstimate, known: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return np.where(known, np.where(estimate.inlier, Reason.INLIER, Reason.FAR), Reason.UNKNOWN).astype(np.uint8)

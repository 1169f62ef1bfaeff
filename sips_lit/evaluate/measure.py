"""Everything that a benchmark measures of one pair with the features of one detector.

What is odd is defined here, once:

- Fewer points than a budget: all there are. No points, or fewer than k inliers at every budget: n_k is infinite.
- A pose error is NaN where nobody knows the true pose, or neither depth maps nor stereo partners exist. It is infinite
  where there is no n_k, where fewer than four matches have a depth, where P3P with RANSAC finds nothing, and, at a budget,
  where the pose has fewer than ``pose_inliers`` inliers.
- Points without scores have no order: n_k is their number if all of them give k inliers, else infinite, and budgets
  below their number are left out.
- Repeatability and matching score are NaN where points can't be transferred (see `sips_lit.metrics.repeatability`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.evaluate.pair_pose import PairPose, PoseErrors, PoseOutcome
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.inliers.point_labels import point_labels
from sips_lit.inliers.verifier import VerifiedMatches, Verifier, all_or_none
from sips_lit.metrics.repeatability import MovedPoints, Repeated, move_points, repeated
from sips_lit.metrics.spread import spread
from sips_lit.types import Features, FramePair, Matches

FloatArray = NDArray[np.float64]
KS = (5, 6, 7, 8, 10, 12, 15, 20, 25, 30)


@dataclass(frozen=True, slots=True)
class Measures:
    """What is measured.

    ``ks``: inliers that a pair needs, within ``n_max`` points; ``budgets``: numbers of points at which the rest is measured;
    ``repeats`` of checks that are random; ``calibration``: budgets for it (probabilities only); ``pose``: whether poses are
    estimated, by RANSAC of ``iterations``, with inliers within ``pose_threshold`` pixels, a pose at a budget counting
    from ``pose_inliers`` on; pose AUC up to ``translation_limit`` (metres) and ``rotation_limit`` (degrees);
    ``threshold`` (pixels) of repeatability; ``cells`` a side of the grid for the spread.
    Raises BadInputError for what can't be measured.
    """

    ks: tuple[int, ...] = KS
    n_max: int = 200
    budgets: tuple[int, ...] = (50,)
    repeats: int = 5
    calibration: tuple[int, ...] = (50, 500)
    pose: bool = True
    iterations: int = 3000
    pose_threshold: float = 3.0
    pose_inliers: int = 10
    translation_limit: float = 1.0
    rotation_limit: float = 1.0
    threshold: float = 3.0
    cells: int = 8
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.ks or not all(1 <= k < self.n_max for k in self.ks) or len(set(self.ks)) < len(self.ks):
            raise BadInputError(
                f"ks is {list(self.ks)} and n_max is {self.n_max}: give different numbers from 1, all below n_max"
            )
        if not all(1 <= n <= self.n_max for n in self.budgets) or len(set(self.budgets)) < len(self.budgets):
            raise BadInputError(
                f"budgets is {list(self.budgets)}: give different numbers from 1 to n_max = {self.n_max}"
            )
        if not all(n >= 1 for n in self.calibration):
            raise BadInputError(f"calibration is {list(self.calibration)}: give numbers of points from 1")
        for name in ("repeats", "iterations", "cells"):
            if getattr(self, name) < 1:
                raise BadInputError(f"{name} is {getattr(self, name)}: give at least 1")
        for name in ("translation_limit", "rotation_limit"):
            if not 0 < getattr(self, name) < math.inf:
                raise BadInputError(f"{name} is {getattr(self, name)}: give a number above 0")


@dataclass(frozen=True, slots=True)
class BudgetMeasurement:
    """Of a pair at one budget: ``inliers``, pose errors and ``outcome`` of the pose (R,); numbers of the first repeat."""

    matches: int
    inliers: NDArray[np.int64]
    rotation_error: FloatArray
    translation_error: FloatArray
    outcome: NDArray[np.int64]
    repeated: Repeated
    spread: float


@dataclass(frozen=True, slots=True)
class PairMeasurement:
    """Of a pair: ``n_k`` and pose errors (R, K), inf = failure; per budget; outcomes of points (``scores``, ``inlier``)."""

    n_k: FloatArray
    rotation_error: FloatArray
    translation_error: FloatArray
    budgets: Mapping[int, BudgetMeasurement]
    outcomes: Mapping[int, tuple[NDArray[np.float32], NDArray[np.bool_]]]
    milliseconds: Mapping[str, float]


def measure(
    pair: FramePair,
    features0: Features,
    features1: Features,
    judge: Verifier,
    pose: PairPose | None,
    m: Measures,
    stereo: StereoMatcher,
    probabilities: bool = False,
    scored: bool = True,
) -> PairMeasurement:
    """Measures a pair by its judge. ``pose`` estimates poses (None: they are not measured).

    ``stereo`` finds depth where there are no maps; ``probabilities``: whether the scores are probabilities of being an
    inlier, to be calibrated; ``scored``: whether there are scores at all, or the order of the points means nothing.
    """
    begin = time.perf_counter()
    shape, points = (judge.repeats, len(m.ks)), max(len(features0), len(features1))
    n_k, rotation, translation = np.full(shape, math.inf), np.full(shape, math.nan), np.full(shape, math.nan)
    for repeat in range(judge.repeats):
        for column, k in enumerate(m.ks):
            needed = judge.needed(k, m.n_max, repeat) if scored else all_or_none(judge, points, k, repeat)
            n_k[repeat, column] = math.inf if needed is None else needed
    verified = time.perf_counter()
    if pose is not None:
        rotation, translation = _errors_at(n_k, judge, pose)
    moved = move_points(pair, features0.keypoints.xy, features1.keypoints.xy, stereo)
    meaningful = [n for n in m.budgets if scored or n >= points]
    budgets = {n: _at_budget(pair, features0, features1, judge, pose, moved, n, m) for n in meaningful}
    outcomes = {n: _outcomes(features0, features1, judge.at(n, 0), n) for n in m.calibration} if probabilities else {}
    elapsed = {"verify": 1e3 * (verified - begin), "metrics": 1e3 * (time.perf_counter() - verified)}
    return PairMeasurement(n_k, rotation, translation, budgets, outcomes, elapsed)


def _errors_at(n_k: FloatArray, judge: Verifier, pose: PairPose) -> tuple[FloatArray, FloatArray]:
    """Pose errors (R, K) of the matches at ``n_k`` (R, K) points."""
    rotation, translation = np.full(n_k.shape, math.inf), np.full(n_k.shape, math.inf)
    for repeat in range(len(n_k)):
        for n in np.unique(n_k[repeat][np.isfinite(n_k[repeat])]):  # several k may need as many points
            at = n_k[repeat] == n
            rotation[repeat, at], translation[repeat, at], _ = pose.errors(judge.at(int(n), repeat).matches, repeat)
    return rotation, translation


def _at_budget(
    pair: FramePair,
    features0: Features,
    features1: Features,
    judge: Verifier,
    pose: PairPose | None,
    moved: tuple[MovedPoints, MovedPoints] | None,
    n: int,
    m: Measures,
) -> BudgetMeasurement:
    verified = [judge.at(n, repeat) for repeat in range(judge.repeats)]
    poses = [PoseErrors(math.nan, math.nan, PoseOutcome.UNKNOWN)] * judge.repeats
    if pose is not None:
        poses = [pose.errors(verified.matches, repeat, m.pose_inliers) for repeat, verified in enumerate(verified)]
    first = verified[0]
    xy0 = features0.keypoints.xy
    inlier0 = first.matches.index0[first.inliers.inlier]
    return BudgetMeasurement(
        matches=len(first.matches),
        inliers=np.array([verified.count for verified in verified], np.int64),
        rotation_error=np.array([pose.rotation for pose in poses]),
        translation_error=np.array([pose.translation for pose in poses]),
        outcome=np.array([pose.outcome for pose in poses], np.int64),
        repeated=_repeated(features0.best(n), features1.best(n), moved, first.matches, m.threshold),
        spread=spread(xy0[inlier0], (pair.image0.shape[1], pair.image0.shape[0]), m.cells),
    )


def _repeated(
    best0: Features,
    best1: Features,
    moved: tuple[MovedPoints, MovedPoints] | None,
    matches: Matches,
    threshold: float,
) -> Repeated:
    if moved is None:
        return Repeated(math.nan, math.nan)
    best = moved[0].best(len(best0)), moved[1].best(len(best1))
    return repeated(best0.keypoints.xy, best1.keypoints.xy, *best, matches, threshold)


def _outcomes(
    features0: Features, features1: Features, verified: VerifiedMatches, n: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Predicted probability and truth of the ``n`` best points of both images, where the truth is known."""
    sides = (
        (features0.keypoints.score[:n], verified.matches.index0, verified.inliers.known0),
        (features1.keypoints.score[:n], verified.matches.index1, verified.inliers.known1),
    )
    scores, truths = [], []
    for score, point_of_match, known in sides:
        labels = point_labels(verified.inliers, point_of_match, known)
        scores.append(score[labels.known])
        truths.append(labels.inlier[labels.known])
    return np.concatenate(scores), np.concatenate(truths)

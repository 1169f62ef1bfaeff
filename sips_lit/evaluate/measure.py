"""Everything that is measured of one pair with the features of one detector.

What is odd is defined here, once:

- Fewer points than a budget: all there are. No points, or fewer than k inliers at every budget: n_k is infinite.
- A pose error is NaN where the true pose is not known, or neither depth maps nor stereo partners exist. It is infinite
  where there is no n_k, where fewer than four matches have a depth, where P3P with RANSAC finds nothing, and, at a budget,
  where the pose has fewer than ``pose_inliers`` inliers.
- Points without scores have no order: n_k is their number if all of them give k inliers, else infinite, and budgets
  below their number are left out.
- Repeatability and matching score are NaN where points can't be transferred (see `sips_lit.metrics.repeatability`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.pair_pose import PairPose, PoseErrors, PoseOutcome, pair_pose
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.inliers.stereo_p3p import StereoP3PInliers
from sips_lit.inliers.verification import VerifiedPair, verify
from sips_lit.match.mutual_nearest import distances, mutual_nearest_lifetimes
from sips_lit.metrics.repeatability import MovedPoints, Repeated, move_points, repeated
from sips_lit.metrics.spread import spread
from sips_lit.types import DisparityMatcher, Features, FramePair, InlierCheck, Matches, ScoreKind

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BudgetMeasurement:
    """Of a pair at one budget: a pair's entry in each array of `sips_lit.evaluate.result.AtBudget`."""

    matches: int
    inliers: NDArray[np.int64]
    rotation_error: FloatArray
    translation_error: FloatArray
    outcome: NDArray[np.int64]
    repeatability: float
    matching_score: float
    spread: float


@dataclass(frozen=True, slots=True)
class PairMeasurement:
    """Of a pair: ``n_k`` and pose errors (R, K), inf = failure; per budget; outcomes of points (scores, inlier or not)."""

    n_k: FloatArray
    rotation_error: FloatArray
    translation_error: FloatArray
    budgets: Mapping[int, BudgetMeasurement]
    outcomes: Mapping[int, tuple[NDArray[np.float32], NDArray[np.bool_]]]
    milliseconds: Mapping[str, float]


def measure_pair(
    pair: FramePair,
    features0: Features,
    features1: Features,
    check: InlierCheck,
    m: Measures,
    scores: ScoreKind = "order",
) -> PairMeasurement:
    """Matches, verifies and measures a pair. ``scores``: what those of the features mean.

    Depth that the keypoints bring is taken as it is. Raises BadInputError for a pair that the check cannot verify.
    """
    milliseconds: dict[str, float] = {}
    stereo = check.stereo or StereoMatcher()
    with _timed(milliseconds, "match"):
        lifetimes = mutual_nearest_lifetimes(distances(features0, features1))
    with _timed(milliseconds, "verify"):
        verified = verify(pair, features0, features1, check, m.search, m.repeats, m.seed, lifetimes)
    pose = None
    if m.pose:
        estimator = StereoP3PInliers(m.pose_threshold, m.iterations, m.seed, stereo)
        pose = pair_pose(pair, features0.keypoints, features1.keypoints, estimator)
    return measure(verified, pose, m, scores, stereo, milliseconds)


def measure(
    verified: VerifiedPair,
    pose: PairPose | None,
    m: Measures,
    scores: ScoreKind = "order",
    stereo: DisparityMatcher | None = None,
    milliseconds: dict[str, float] | None = None,
) -> PairMeasurement:
    """Measures a verified pair. ``pose`` estimates poses (None: they are not measured).

    ``stereo`` finds depth where keypoints bring none and there are no maps; ``milliseconds``: times so far.
    """
    milliseconds = {} if milliseconds is None else milliseconds
    ordered, repeats = scores != "none", verified.verifier.repeats
    n_k = np.full((repeats, len(m.every_k)), math.inf)
    with _timed(milliseconds, "verify"):
        for repeat in range(repeats):
            for column, k in enumerate(m.every_k):
                needed = verified.points_needed(k, m.n_max, repeat, ordered)
                n_k[repeat, column] = math.inf if needed is None else needed
    with _timed(milliseconds, "metrics"):
        rotation, translation = _errors_at(n_k, verified, pose)
        keypoints = verified.features0.keypoints, verified.features1.keypoints
        moved = move_points(verified.pair, *keypoints, stereo or StereoMatcher())
        points = max(map(len, keypoints))
        budgets = {n: _at_budget(verified, pose, moved, n, m) for n in m.every_n if ordered or n >= points}
        outcomes = {n: verified.outcomes(n) for n in m.calibration} if scores == "probability" else {}
    return PairMeasurement(n_k, rotation, translation, budgets, outcomes, milliseconds)


def _errors_at(n_k: FloatArray, verified: VerifiedPair, pose: PairPose | None) -> tuple[FloatArray, FloatArray]:
    """Rotation and translation errors (R, K) of the poses of the matches at ``n_k`` (R, K) points."""
    if pose is None:
        return np.full(n_k.shape, math.nan), np.full(n_k.shape, math.nan)
    rotation, translation = np.full(n_k.shape, math.inf), np.full(n_k.shape, math.inf)
    for repeat in range(len(n_k)):
        for n in np.unique(n_k[repeat][np.isfinite(n_k[repeat])]):  # several k may need as many points
            errors, at = pose.errors(verified.at(int(n), repeat).matches, repeat), n_k[repeat] == n
            rotation[repeat, at], translation[repeat, at] = errors.rotation, errors.translation
    return rotation, translation


def _at_budget(
    verified: VerifiedPair, pose: PairPose | None, moved: tuple[MovedPoints, MovedPoints] | None, n: int, m: Measures
) -> BudgetMeasurement:
    answers = [verified.at(n, repeat) for repeat in range(verified.verifier.repeats)]
    poses = [PoseErrors(math.nan, math.nan, PoseOutcome.UNKNOWN)] * len(answers)
    if pose is not None:
        poses = [pose.errors(answer.matches, repeat, m.pose_inliers) for repeat, answer in enumerate(answers)]
    matches, inliers = answers[0]
    found = _repeated(verified, moved, matches, n, m.threshold)
    height, width = verified.pair.image0.shape
    return BudgetMeasurement(
        matches=len(matches),
        inliers=np.array([answer.inlier_count for answer in answers], np.int64),
        rotation_error=np.array([errors.rotation for errors in poses]),
        translation_error=np.array([errors.translation for errors in poses]),
        outcome=np.array([errors.outcome for errors in poses], np.int64),
        repeatability=found.repeatability,
        matching_score=found.matching_score,
        spread=spread(verified.features0.keypoints.xy[matches.index0[inliers.inlier]], (width, height), m.cells),
    )


def _repeated(
    verified: VerifiedPair, moved: tuple[MovedPoints, MovedPoints] | None, matches: Matches, n: int, threshold: float
) -> Repeated:
    if moved is None:
        return Repeated(math.nan, math.nan)
    xy0, xy1 = verified.features0.keypoints.xy[:n], verified.features1.keypoints.xy[:n]
    return repeated(xy0, xy1, moved[0].best(n), moved[1].best(n), matches, threshold)


@contextmanager
def _timed(milliseconds: dict[str, float], stage: str) -> Iterator[None]:
    """Adds the time that it takes to a stage."""
    begin = time.perf_counter()
    yield
    milliseconds[stage] = milliseconds.get(stage, 0.0) + 1e3 * (time.perf_counter() - begin)

"""Everything that is measured of one pair with the features of one detector.

What is odd is defined here, once:

- Fewer points than a budget: all there are. No points, or fewer than k inliers at every budget: n_k is infinite.
- A pose error is NaN where the true pose is not known, or neither depth maps nor stereo partners exist. It is infinite
  where there is no n_k, where fewer than four matches have a depth, where P3P with RANSAC finds nothing, and, at a budget,
  where the pose has fewer than ``pose_inliers`` inliers.
- Points without scores have no order: n_k is their number if all of them give k inliers, else infinite, and budgets
  below their number are left out.
- A point is unknown where the check cannot tell whether it is an inlier: no depth, neither its own nor that of a match. It
  counts in n_k like any other. Judged n_k counts the judged points alone: of the n_max best of each image the unknown ones
  are removed, and the rest, in its order, is matched and verified anew.
- Repeatability and matching score are NaN where points can't be transferred (see `sips_lit.metrics.repeatability`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.result import AtBudget, PoseOutcome
from sips_lit.geometry.pose import rotation_error, translation_error
from sips_lit.geometry.projection import posed_views
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.inliers.stereo_p3p import PoseWeights, PreparedStereoP3P, StereoP3PInliers
from sips_lit.inliers.verification import VerifiedPair, verify, verify_judged
from sips_lit.matching.mutual_nearest import distances, mutual_nearest_lifetimes
from sips_lit.metrics.repeatability import MovedPoints, Repeated, move_points, repeated
from sips_lit.metrics.spread import spread
from sips_lit.types import DisparityMatcher, Features, FloatArray, FramePair, InlierCheck, Keypoints, Matches, ScoreKind

Best = Callable[[Keypoints, int], Keypoints]


class PoseErrors(NamedTuple):
    """Errors in degrees and metres, infinite where no pose was found."""

    rotation: float
    translation: float
    outcome: PoseOutcome


@dataclass(frozen=True, slots=True)
class PairPose:
    """Estimates the pose of a pair by P3P in RANSAC, ``estimator``, and compares it with the true ``T_1_0``.

    ``weights``: of its inliers, when it is refined on them.
    """

    estimator: PreparedStereoP3P
    T_1_0: FloatArray
    weights: PoseWeights = "none"

    def errors(self, matches: Matches, repeat: int, least: int = 0) -> PoseErrors:
        """How far the pose of the matches is from the true one; infinitely without a pose of ``least`` inliers."""
        if self.estimator.usable(matches) < 4:
            return PoseErrors(math.inf, math.inf, PoseOutcome.FEW_MATCHES)
        estimate = self.estimator.refined(self.estimator.estimate(matches, repeat), matches, self.weights)
        if estimate.T_1_0 is None:
            return PoseErrors(math.inf, math.inf, PoseOutcome.NO_AGREEMENT)
        if estimate.inliers < least:
            return PoseErrors(math.inf, math.inf, PoseOutcome.FEW_INLIERS)
        errors = rotation_error(estimate.T_1_0, self.T_1_0), translation_error(estimate.T_1_0, self.T_1_0)
        return PoseErrors(*errors, PoseOutcome.FOUND)


def pair_pose(
    pair: FramePair,
    keypoints0: Keypoints,
    keypoints1: Keypoints,
    check: StereoP3PInliers,
    weights: PoseWeights = "none",
) -> PairPose | None:
    """What estimates the pose of a pair; None where the true one is not known, or nothing tells the depth of any point."""
    posed = posed_views(pair)
    return None if posed is None else PairPose(check.prepare(pair, keypoints0, keypoints1), posed[2], weights)


@dataclass(frozen=True, slots=True)
class PairMeasurement:
    """Of a pair: ``n_k``, of all and of judged points, and pose errors (R, K), inf = failure; per budget; per stage.

    ``unknown`` (): share of the points of both images whose truth is not known. ``outcomes`` of points: scores, inlier or
    not. ``residuals`` by budget, of points that have covariances: see `VerifiedPair.residuals`.
    """

    n_k: FloatArray
    n_k_judged: FloatArray
    unknown: FloatArray
    rotation_error: FloatArray
    translation_error: FloatArray
    budgets: Mapping[int, AtBudget]
    outcomes: Mapping[int, tuple[NDArray[np.float32], NDArray[np.bool_]]]
    milliseconds: Mapping[str, float]
    residuals: Mapping[int, tuple[NDArray[np.float32], NDArray[np.float32]]] = field(default_factory=dict)


def measure_pair(
    pair: FramePair,
    features0: Features,
    features1: Features,
    check: InlierCheck,
    m: Measures,
    scores: ScoreKind = "order",
    best: Best = Keypoints.best,
) -> PairMeasurement:
    """Matches, verifies and measures a pair. ``scores``: what those of the features mean; ``best``: the detector's.

    Depth that the keypoints bring is taken as it is. Raises BadInputError for a pair that the check cannot verify.
    """
    milliseconds: dict[str, float] = {}
    stereo = check.stereo or StereoMatcher()
    with _timed(milliseconds, "match"):
        lifetimes = mutual_nearest_lifetimes(distances(features0, features1))
    with _timed(milliseconds, "verify"):
        verified = verify(pair, features0, features1, check, m.search, m.repeats, m.seed, lifetimes)
    with _timed(milliseconds, "metrics"):
        judged = verify_judged(verified, check, m.n_max, m.search, m.repeats, m.seed)
    pose = None
    if m.pose:
        estimator = StereoP3PInliers(m.pose_threshold, m.iterations, m.seed, stereo)
        pose = pair_pose(pair, features0.keypoints, features1.keypoints, estimator, m.pose_weights)
    return measure(verified, pose, m, scores, stereo, milliseconds, judged, best)


def measure(
    verified: VerifiedPair,
    pose: PairPose | None,
    m: Measures,
    scores: ScoreKind = "order",
    stereo: DisparityMatcher | None = None,
    milliseconds: dict[str, float] | None = None,
    judged: VerifiedPair | None = None,
    best: Best = Keypoints.best,
) -> PairMeasurement:
    """Measures a verified pair. ``pose`` estimates poses (None: they are not measured).

    ``stereo`` finds depth where keypoints bring none and there are no maps; ``milliseconds``: times so far; ``judged``: the
    pair with its judged points alone (None: all are); ``best``: see `VerifiedPair.outcomes`.
    """
    milliseconds = {} if milliseconds is None else milliseconds
    ordered, judged = scores != "none", judged or verified
    with _timed(milliseconds, "verify"):
        n_k = _points_needed(verified, m, ordered)
    with _timed(milliseconds, "metrics"):
        n_k_judged = n_k if judged is verified else _points_needed(judged, m, ordered)
        rotation, translation = _errors_at(n_k, verified, pose)
        keypoints = verified.features0.keypoints, verified.features1.keypoints
        moved = move_points(verified.pair, *keypoints, stereo or StereoMatcher())
        points = max(map(len, keypoints))
        budgets = {n: _at_budget(verified, pose, moved, n, m) for n in m.every_n if ordered or n >= points}
        outcomes = {n: verified.outcomes(n, best) for n in m.calibration} if scores == "probability" else {}
        residuals = {n: found for n in budgets if (found := verified.residuals(n)) is not None}
    unknown = _unknown_share(verified, judged, m.n_max)
    errors = rotation, translation
    return PairMeasurement(n_k, n_k_judged, unknown, *errors, budgets, outcomes, milliseconds, residuals)


def _points_needed(verified: VerifiedPair, m: Measures, ordered: bool) -> FloatArray:
    """n_k (R, K), infinite for a failure."""
    n_k = np.full((verified.verifier.repeats, len(m.every_k)), math.inf)
    for repeat in range(len(n_k)):
        for column, k in enumerate(m.every_k):
            needed = verified.points_needed(k, m.n_max, repeat, ordered)
            n_k[repeat, column] = math.inf if needed is None else needed
    return n_k


def _unknown_share(verified: VerifiedPair, judged: VerifiedPair, n: int) -> FloatArray:
    """Share (), of the ``n`` best points of both images, that is not judged; NaN without points."""
    points, known = (sum(min(len(f), n) for f in (v.features0, v.features1)) for v in (verified, judged))
    return np.array(1 - known / points if points else math.nan)


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
) -> AtBudget:
    answers = [verified.at(n, repeat) for repeat in range(verified.verifier.repeats)]
    poses = [PoseErrors(math.nan, math.nan, PoseOutcome.UNKNOWN)] * len(answers)
    if pose is not None:
        poses = [pose.errors(answer.matches, repeat, m.pose_inliers) for repeat, answer in enumerate(answers)]
    matches, inliers = answers[0]
    xy0, xy1 = verified.features0.keypoints.xy, verified.features1.keypoints.xy
    found = Repeated(math.nan, math.nan)
    if moved is not None:
        found = repeated(xy0[:n], xy1[:n], moved[0].best(n), moved[1].best(n), matches, m.threshold)
    places = xy0[matches.index0[inliers.inlier]]
    height, width = verified.pair.image0.shape
    return AtBudget(
        n=n,
        matches=np.array(len(matches)),
        inliers=np.array([answer.inlier_count for answer in answers], np.int64),
        rotation_error=np.array([errors.rotation for errors in poses]),
        translation_error=np.array([errors.translation for errors in poses]),
        outcome=np.array([errors.outcome for errors in poses], np.int64),
        repeatability=np.array(found.repeatability),
        matching_score=np.array(found.matching_score),
        spread=np.array(spread(places, (width, height), m.cells)),
    )


@contextmanager
def _timed(milliseconds: dict[str, float], stage: str) -> Iterator[None]:
    """Adds the time that it takes to a stage."""
    begin = time.perf_counter()
    yield
    milliseconds[stage] = milliseconds.get(stage, 0.0) + 1e3 * (time.perf_counter() - begin)

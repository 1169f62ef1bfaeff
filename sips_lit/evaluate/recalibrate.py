"""Recalibration on verified pairs: points with their truth at several budgets, a part held back, errors before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.detect.budget import smallest_budget
from sips_lit.detect.fit_recalibration import PointGroup
from sips_lit.detect.recalibration import AS_TRAINED, Recalibration
from sips_lit.detect.shared_effect import Floats, logit, sigmoid
from sips_lit.evaluate.features import ImageFeatures
from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.method import Method
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.evaluate.runner import Frame, extract_all, measure_depths, side_by_side
from sips_lit.inliers.verification import VerifiedPair, verify, verify_judged
from sips_lit.metrics.calibration import CalibrationResult, bin_sums, summarise
from sips_lit.metrics.covariance import CovarianceReliability, reliability_sums
from sips_lit.metrics.covariance import summarise as covariance_reliability
from sips_lit.metrics.coverage import Coverage, coverage

ASKED: Final = (0.5, 0.7, 0.8, 0.9, 0.95)
"""Probabilities of k inliers that are asked for."""
BINS: Final = 20


@dataclass(frozen=True, slots=True)
class JudgedPair:
    """What a pair tells about its points, those left out whose truth is not known at any budget.

    ``logits``: the network's, best first, of both images; ``groups``: of both images, by budget; ``inliers`` (n_max + 1,)
    among the n best points of both images; ``residuals`` of the inlier matches at the largest budget, with the covariances
    that the points claim, if they do: see `VerifiedPair.residuals`.
    """

    logits: tuple[Floats, Floats]
    groups: Mapping[int, tuple[PointGroup, PointGroup]]
    inliers: NDArray[np.int64]
    residuals: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None


@dataclass(frozen=True, slots=True)
class Split:
    """Positions of pairs to ``fit`` to and of those ``held`` back, and ``how`` they differ."""

    fit: tuple[int, ...]
    held: tuple[int, ...]
    how: str


def split_pairs(pairs: PairSet) -> Split:
    """Every second sequence that has pairs is held back; of one sequence the pairs of its later half."""
    listed = pairs.listed
    used = sorted({pair.sequence for pair in listed})
    if len(used) > 1:
        back = set(used[1::2])
        held = [at for at, pair in enumerate(listed) if pair.sequence in back]
        how = f"{len(back)} of {len(used)} sequences held back"
    else:
        in_time = sorted(range(len(listed)), key=lambda at: (listed[at].index0 + listed[at].index1, at))
        held = sorted(in_time[(len(listed) + 1) // 2 :])
        how = "the later half of the pairs of its only sequence held back"
    return Split(tuple(at for at in range(len(listed)) if at not in set(held)), tuple(held), how)


def judge_pairs(
    method: Method,
    pairs: PairSet,
    measures: Measures,
    cache_folder: Path | None = None,
    workers: int = 2,
) -> list[JudgedPair]:
    """Detects, matches and verifies every pair. ``method``: with a detector whose scores are not recalibrated.

    Points are judged at the budgets ``measures.calibration``, inliers counted up to ``measures.n_max`` points. What
    is random in a check is drawn once.
    """
    label = f"{pairs.title}, {method.name}"
    most = measures.points("probability")
    features = measure_depths(pairs, extract_all(method, pairs, cache_folder, most, label), workers, label)
    one = partial(_judge, pairs, features, measures)
    return side_by_side(one, range(len(pairs)), workers, label, "pair")


def _judge(
    pairs: PairSet,
    features: Mapping[Frame, ImageFeatures],
    m: Measures,
    at: int,
) -> JudgedPair:
    pair, check = pairs.listed[at], pairs.check(at)
    features0, features1 = (features[pair.sequence, index].features for index in (pair.index0, pair.index1))
    verified = verify(pairs.read(at, depth=True), features0, features1, check, m.search, 1, m.seed)
    return judged_pair(
        verify_judged(verified, check, m.points("probability"), m.search, 1, m.seed), m.calibration, m.n_max
    )


def judged_pair(verified: VerifiedPair, budgets: Sequence[int], n_max: int) -> JudgedPair:
    """The record of a verified pair."""
    logits0, logits1 = (logit(features.keypoints.score) for features in (verified.features0, verified.features1))
    groups = {}
    for n in budgets:
        of0, of1 = (
            PointGroup(values[:n][labels.known], labels.inlier[labels.known], min(n, len(values)))
            for values, labels in zip((logits0, logits1), verified.labels(n), strict=True)
        )
        groups[n] = (of0, of1)
    inliers = np.array([verified.at(n).inlier_count for n in range(n_max + 1)], np.int64)
    return JudgedPair((logits0, logits1), groups, inliers, verified.residuals(max(budgets)))


def groups_of(pairs: Sequence[JudgedPair]) -> list[PointGroup]:
    """All groups of points."""
    return [group for pair in pairs for both in pair.groups.values() for group in both]


def calibration_at(pairs: Sequence[JudgedPair], n: int, recalibration: Recalibration = AS_TRAINED) -> CalibrationResult:
    """Calibration of the ``n`` best points."""
    sums = np.zeros((4, BINS))
    for pair in pairs:
        for group in pair.groups[n]:
            sums += bin_sums(group.probability(recalibration), group.inlier, BINS)
    return summarise(sums)


def covariance_at(pairs: Sequence[JudgedPair], factor: float = 1.0) -> CovarianceReliability | None:
    """Reliability of covariances that are multiplied by ``factor``; None where no pair has residuals or no point has one."""
    sums = [
        reliability_sums(residual, factor * claimed, BINS)
        for residual, claimed in (pair.residuals for pair in pairs if pair.residuals is not None)
    ]
    return covariance_reliability(np.sum(sums, 0)) if sums else None


def coverage_of(
    pairs: Sequence[JudgedPair],
    k: int,
    recalibration: Recalibration = AS_TRAINED,
    asked: Sequence[float] = ASKED,
) -> list[Coverage]:
    """Coverage of budgets for ``k`` inliers: each image of a pair chooses one, and the other image keeps as many points."""
    inliers = np.array([pair.inliers for pair in pairs for _ in pair.logits], np.int64)
    n_max = inliers.shape[1] - 1
    chosen: list[list[int | None]] = [[] for _ in asked]
    for pair in pairs:
        for logits in pair.logits:
            best = logits[:n_max]
            probability = sigmoid(recalibration.logits(best, len(best)))
            for budgets, confidence in zip(chosen, asked, strict=True):
                budgets.append(smallest_budget(probability, k, confidence, recalibration))
    return [coverage(q, budgets, inliers, k) for q, budgets in zip(asked, chosen, strict=True)]

"""The numbers of a row of the table, and the curves, from what was measured of a detector."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.evaluate.pair_pose import PoseOutcome
from sips_lit.evaluate.result import NO_SCORES, AtBudget, FloatArray, MethodResult
from sips_lit.metrics.pose_auc import pose_auc
from sips_lit.metrics.succinctness import SuccinctnessResult, histogram, summarise

PAPERS_K: Final = 10
PAPERS_BUDGET: Final = 50


@dataclass(frozen=True, slots=True)
class Summary:
    """One detector on one pair set in numbers: infinite where the detector never gets there, NaN where undefined.

    For ``k`` inliers within ``n_max`` points: ``auc``, ``n_at_80``, ``median``, ``mean_needed`` (over the successes) and
    ``failures`` (mean over the repeats). At ``n`` points: pose AUC of ``translation`` and ``rotation`` up to ``limits``
    (metres, degrees), ``no_pose`` (pairs, mean over the repeats), ``repeatability``, ``matching_score``, ``spread``.
    ``*_deviation``: standard deviation over the repeats, NaN for one. ``ece`` by points an image, ``milliseconds`` by
    stage. ``scored``: whether the points have an order, or all of an image are judged or nothing.
    """

    pairs: int
    k: int
    n_max: int
    n: int | None
    scored: bool
    limits: tuple[float, float]
    auc: float
    auc_deviation: float
    n_at_80: float
    median: float
    mean_needed: float
    failures: float
    translation: float
    translation_deviation: float
    rotation: float
    rotation_deviation: float
    no_pose: float
    repeatability: float
    matching_score: float
    spread: float
    points: float
    ece: Mapping[int, float]
    milliseconds: Mapping[str, float]


def summary(result: MethodResult) -> Summary:
    """The row of a detector."""
    k, n = main_k(result), main_budget(result)
    pooled = succinctness(result, k)
    needed = result.n_k[:, :, result.ks.index(k)]
    succeeded = needed[needed <= result.n_max]
    # points without scores may not have been measured at the budget of the others
    at = result.budgets[n] if n is not None and n in result.budgets else _nothing(len(result.pairs))
    limits = pose_limits(result)
    aucs = [succinctness(result, k, repeat).auc for repeat in range(needed.shape[1])]
    return Summary(
        pairs=len(result.pairs),
        k=k,
        n_max=result.n_max,
        n=n,
        scored=result.protocol.get("scores") != NO_SCORES,
        limits=limits,
        auc=pooled.auc,
        auc_deviation=_deviation(aucs),
        n_at_80=np.inf if pooled.n_at_80 is None else pooled.n_at_80,
        median=np.inf if pooled.median is None else pooled.median,
        mean_needed=known_mean(succeeded),
        failures=pooled.failures / max(needed.shape[1], 1),
        translation=error_auc(at.translation_error, limits[0]),
        translation_deviation=_auc_deviation(at.translation_error, limits[0]),
        rotation=error_auc(at.rotation_error, limits[1]),
        rotation_deviation=_auc_deviation(at.rotation_error, limits[1]),
        no_pose=_without_pose(at),
        repeatability=known_mean(at.repeatability),
        matching_score=known_mean(at.matching_score),
        spread=known_mean(at.spread),
        points=known_mean(np.concatenate([result.points0, result.points1])),
        ece={budget: calibration.ece for budget, calibration in sorted(result.calibration.items())},
        milliseconds=dict(result.milliseconds),
    )


def main_k(result: MethodResult) -> int:
    """The k of tables and curves: the protocol's, else the paper's, else the first."""
    asked = result.protocol.get("k", PAPERS_K)
    return asked if asked in result.ks else PAPERS_K if PAPERS_K in result.ks else result.ks[0]


def main_budget(result: MethodResult) -> int | None:
    """The points an image of tables and pose curves: the paper's 50, else the fewest asked for; None if none were."""
    asked = result.protocol.get("budgets", result.budgets)
    return PAPERS_BUDGET if PAPERS_BUDGET in asked else min(asked, default=None)


def pose_limits(result: MethodResult) -> tuple[float, float]:
    """Errors up to which pose AUC is measured: metres, degrees. The protocol's, else the paper's 1 m and 1 degree."""
    translation, rotation = (result.protocol.get(f"{error}_limit", 1.0) for error in ("translation", "rotation"))
    return float(translation), float(rotation)


def succinctness(result: MethodResult, k: int, repeat: int | None = None) -> SuccinctnessResult:
    """Succinctness for one of ``result.ks``, of one repeat or of all of them pooled."""
    needed = result.n_k[:, :, result.ks.index(k)]
    chosen = needed if repeat is None else needed[:, [repeat]]
    counts = histogram([int(n) if np.isfinite(n) else None for n in chosen.ravel()], result.n_max)
    return summarise(counts, k)


def error_auc(errors: NDArray[Any], limit: float) -> float:
    """Pose AUC of the errors that are known (not NaN); NaN when none is."""
    known = errors[~np.isnan(errors)]
    return pose_auc(known, limit) if known.size else float("nan")


def error_curve(errors: NDArray[Any], limit: float) -> tuple[FloatArray, FloatArray] | None:
    """Steps (x, y) of the fraction of the known errors that are at most x, from 0 to ``limit``; None when none is known."""
    known = np.sort(errors[~np.isnan(errors)])
    if not known.size:
        return None
    within = known[known <= limit]
    x = np.concatenate([[0.0], within, [limit]])
    y = np.concatenate([[0.0], np.arange(1, len(within) + 1), [len(within)]]) / known.size
    return x, y


def median_needed(result: MethodResult, k: int) -> FloatArray:
    """n_k (P,) of each pair, the median over the repeats; inf where it failed."""
    return over_repeats(result.n_k[:, :, result.ks.index(k)])


def over_repeats(values: FloatArray) -> FloatArray:
    """Median (P,) over the repeats (P, R), the middle one or the better of the two: always one that was measured.

    inf, a failure, is the worst; NaN, what is not known, stays.
    """
    ordered = np.sort(values, axis=1)
    middle: FloatArray = ordered[:, (values.shape[1] - 1) // 2]
    return np.where(np.isnan(values).all(axis=1), np.nan, middle)


def known_mean(values: NDArray[Any]) -> float:
    """Mean of what is not NaN; NaN of nothing."""
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else float("nan")


def _deviation(values: list[float]) -> float:
    return float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")


def _auc_deviation(errors: FloatArray, limit: float) -> float:
    return _deviation([error_auc(errors[:, repeat], limit) for repeat in range(errors.shape[1])])


def _without_pose(at: AtBudget) -> float:
    """How many pairs have no pose though the true one is known, the mean over the repeats; NaN where none is known."""
    known: NDArray[np.bool_] = at.outcome != PoseOutcome.UNKNOWN
    if not known.any():
        return float("nan")
    return float((known & (at.outcome != PoseOutcome.FOUND)).sum() / known.shape[1])


def _nothing(pairs: int) -> AtBudget:
    unknown, counts = np.full(pairs, np.nan), np.zeros((pairs, 1), np.int64)
    errors, outcome = unknown[:, None], np.full((pairs, 1), PoseOutcome.UNKNOWN, np.int64)
    return AtBudget(0, counts[:, 0], counts, errors, errors, outcome, unknown, unknown, unknown)

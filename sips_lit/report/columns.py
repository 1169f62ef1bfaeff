"""The columns of the table: title, definition, formula and digits of each number in one place."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from sips_lit.evaluate.pair_pose import PoseOutcome
from sips_lit.evaluate.result import AtBudget, FloatArray, MethodResult
from sips_lit.report.summary import (
    error_auc,
    known_mean,
    main_budget,
    main_k,
    over_repeats_deviation,
    pose_limits,
    succinctness,
    without_pose,
)

OWN_N: Final = "own n only"
"""Tag of detectors whose points have no order."""


@dataclass(frozen=True, slots=True)
class Column:
    """``key`` heads it in CSV, ``title`` on the page; ``definition`` is a sentence of the glossary.

    ``better`` is 1 where more is better, -1 where less is, 0 where it is neither.
    """

    key: str
    title: str
    definition: str
    digits: int
    better: int
    value: Callable[[MethodResult], float]
    deviation: Callable[[MethodResult], float] | None = None


def columns_of(results: Sequence[MethodResult]) -> list[Column]:
    """The columns of a pair set's table; those without any value are left out."""
    if not results:
        return []
    first = results[0]
    stages = dict.fromkeys(stage for result in results for stage in result.milliseconds)
    budgets = sorted({n for result in results for n in result.calibration})
    columns = [*_succinctness(main_k(first), first.n_max), *_at_budget(main_budget(first), *pose_limits(first))]
    columns += [*map(_ece, budgets), _points(first.n_max), *map(_stage, stages)]
    return [column for column in columns if not all(math.isnan(column.value(result)) for result in results)]


def auc_of(result: MethodResult) -> float:
    """The succinctness AUC for the main k: what methods are ordered by."""
    return succinctness(result, main_k(result)).auc


def best_first(results: Sequence[MethodResult]) -> list[MethodResult]:
    """The methods by AUC, those without one last."""
    return sorted(results, key=lambda result: -np.nan_to_num(auc_of(result), nan=-1))


def is_scored(result: MethodResult) -> bool:
    """Whether the points have an order, or all of an image count together or not at all."""
    return result.protocol.get("scores") != "none"


def text_of(value: float, digits: int) -> str:
    """A value as people read it: ``never`` for what is infinite, a dash for what is undefined."""
    if math.isnan(value):
        return "-"
    return "never" if math.isinf(value) else f"{value:.{digits}f}"


def _succinctness(k: int, n_max: int) -> list[Column]:
    return [
        Column(
            "n_at_80",
            "n at 80 %",
            f"The fewest points per image with which 80 % of the pairs have {k} inliers.",
            0,
            -1,
            lambda r: _reached(succinctness(r, k).n_at_80),
        ),
        Column(
            "median_n",
            "median n",
            f"The fewest points per image with which half of the pairs have {k} inliers.",
            0,
            -1,
            lambda r: _reached(succinctness(r, k).median),
        ),
        Column(
            "mean_n",
            f"mean n to {k} inliers",
            f"Mean of n_{k} over the pairs that get {k} inliers; read it together with the failures, which it leaves out.",
            1,
            -1,
            lambda r: known_mean(_needed(r, k)[_needed(r, k) <= r.n_max]),
        ),
        Column(
            "auc",
            f"AUC-{n_max}",
            f"Area under the succinctness curve up to {n_max} points, divided by {n_max}: "
            f"1 - {k} / {n_max} = {1 - k / n_max:.3f} at best, 0 when every pair fails. "
            "± is the standard deviation over the repeats of a random verification.",
            3,
            1,
            lambda r: succinctness(r, k).auc,
            lambda r: over_repeats_deviation([succinctness(r, k, repeat).auc for repeat in range(r.n_k.shape[1])]),
        ),
        Column(
            "failures",
            "failures",
            f"Pairs without {k} inliers at any n up to {n_max}; the mean over the repeats.",
            1,
            -1,
            lambda r: succinctness(r, k).failures / max(r.n_k.shape[1], 1),
        ),
    ]


def _at_budget(n: int | None, metres: float, degrees: float) -> list[Column]:
    if n is None:
        return []
    failed = "A pair without a pose counts as an infinite error; pairs whose true pose is not known are left out."
    return [
        Column(
            f"pose_auc_{metres:g}m",
            f"pose AUC-{metres:g} m at {n}",
            "Area under the curve of translation errors (Euclidean distance, metres) from 0 to "
            f"{metres:g} m, divided by {metres:g} m: 1 is perfect. {failed}",
            3,
            1,
            lambda r: error_auc(_at(r, n).translation_error, metres),
            lambda r: _auc_deviation(r, n, "translation_error", metres),
        ),
        Column(
            f"pose_auc_{degrees:g}deg",
            f"pose AUC-{degrees:g}° at {n}",
            f"The same of rotation errors (geodesic angle) from 0 to {degrees:g} degree{'' if degrees == 1 else 's'}.",
            3,
            1,
            lambda r: error_auc(_at(r, n).rotation_error, degrees),
            lambda r: _auc_deviation(r, n, "rotation_error", degrees),
        ),
        Column(
            "no_pose",
            f"no pose at {n}",
            f"Pairs without a pose from the {n} best points, though the true one is known; the mean over the repeats. "
            "Why is counted in a table below.",
            1,
            -1,
            lambda r: without_pose(_at(r, n).outcome),
        ),
        Column(
            "repeatability",
            f"repeatability at {n}",
            f"Of the {n} best points of the image that has fewer in the common view, the fraction found again in the other "
            "image. NaN where the true position in the other image is not known.",
            3,
            1,
            lambda r: known_mean(_at(r, n).repeatability),
        ),
        Column(
            "matching_score",
            f"matching score at {n}",
            f"Of the {n} best points in the common view, the fraction that is matched rightly by descriptor.",
            3,
            1,
            lambda r: known_mean(_at(r, n).matching_score),
        ),
        Column(
            "spread",
            f"spread at {n}",
            "Fraction of the cells of a grid over the image that hold an inlier: more is better for the pose.",
            3,
            1,
            lambda r: known_mean(_at(r, n).spread),
        ),
    ]


def _ece(n: int) -> Column:
    return Column(
        f"ece_{n}",
        f"ECE at {n}",
        f"Expected calibration error: mean distance, over the {n} best points, between predicted probability and "
        "frequency of inliers in 20 bins. Only for detectors whose scores are probabilities.",
        3,
        -1,
        lambda r: r.calibration[n].ece if n in r.calibration else math.nan,
    )


def _points(n_max: int) -> Column:
    definition = f"Mean number of points that the detector found in an image when asked for {n_max} or more."
    return Column(
        "points", "points found", definition, 1, 0, lambda r: known_mean(np.concatenate([r.points0, r.points1]))
    )


def _stage(stage: str) -> Column:
    definition = f"Mean wall-clock time of {stage} (detect, describe and depth: per image; all others: per pair)."
    return Column(f"{stage}_ms", f"{stage}, ms", definition, 1, -1, lambda r: r.milliseconds.get(stage, math.nan))


def _reached(n: int | None) -> float:
    return math.inf if n is None else n


def _needed(result: MethodResult, k: int) -> FloatArray:
    return result.n_k[:, :, result.ks.index(k)]


def _at(result: MethodResult, n: int) -> AtBudget:
    """What was measured at a budget; nothing of points without scores, which are not measured at every budget."""
    if n in result.budgets:
        return result.budgets[n]
    unknown, outcome = np.full((len(result.pairs), 1), np.nan), np.full((len(result.pairs), 1), PoseOutcome.UNKNOWN)
    none, counts = unknown[:, 0], np.zeros((len(result.pairs), 1), np.int64)
    return AtBudget(n, counts[:, 0], counts, unknown, unknown, outcome, none, none, none)


def _auc_deviation(result: MethodResult, n: int, error: str, limit: float) -> float:
    errors: FloatArray = getattr(_at(result, n), error)
    return over_repeats_deviation([error_auc(errors[:, repeat], limit) for repeat in range(errors.shape[1])])

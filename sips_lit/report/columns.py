"""The columns of the table: title, definition, formula and digits of each number in one place, for every output."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from sips_lit.evaluate.result import AtBudget, FloatArray, MethodResult
from sips_lit.metrics.succinctness import SuccinctnessResult
from sips_lit.report.summary import (
    error_auc,
    known_mean,
    main_budget,
    main_k,
    needed_points,
    over_repeats_deviation,
    pose_limits,
    succinctness,
    unknown_share,
    without_pose,
)

OWN_N: Final = "own n only"
"""Tag of methods whose points have no order."""
Number = Callable[[MethodResult], float]
_STAGES: Final = ("detect", "describe", "depth", "match", "verify", "metrics")


@dataclass(frozen=True, slots=True)
class Column:
    """``key`` heads it in CSV, ``title`` on the page; ``definition`` is a sentence or two of the glossary.

    ``better`` is 1 where more is better, -1 where less is, 0 where it is neither. ``value`` computes it, and
    ``deviation``, where there is one, its standard deviation over the repeats. ``count``: whole
    numbers are shown without decimals.
    """

    key: str
    title: str
    definition: str
    digits: int
    better: int
    value: Number
    deviation: Number | None = None
    count: bool = False

    def text(self, value: float) -> str:
        """A value of this column as people read it, see `text_of`."""
        return text_of(value, 0 if self.count and float(value).is_integer() else self.digits)


def columns_of(methods: Sequence[MethodResult]) -> list[Column]:
    """The columns of a pair set's table; those without any value are left out."""
    if not methods:
        return []
    first, n = methods[0], main_budget(methods[0])
    timed = {stage for method in methods for stage in method.milliseconds}
    stages = sorted(timed, key=lambda stage: (_STAGES.index(stage) if stage in _STAGES else len(_STAGES), stage))
    budgets = sorted({n for method in methods for n in method.calibration})
    columns = [*_succinctness(main_k(first), first.n_max)]
    if any(unknown_share(method) > 0 for method in methods):
        columns += _judged(main_k(first), first.n_max)
    columns += [] if n is None else [*_pose(n, *pose_limits(first)), *_at_n(n)]
    columns += [*map(_ece, budgets), *(() if n is None else _covariance(n)), _points(first.n_max), *map(_stage, stages)]
    return [column for column in columns if not all(math.isnan(column.value(method)) for method in methods)]


def auc_of(result: MethodResult) -> float:
    """The succinctness AUC for the main k: what methods are ordered by."""
    return succinctness(result, main_k(result)).auc


def best_first(results: Sequence[MethodResult]) -> list[MethodResult]:
    """The methods by AUC, those without one last."""
    return sorted(results, key=lambda result: -np.nan_to_num(auc_of(result), nan=-1))


def is_scored(result: MethodResult) -> bool:
    """Whether the points have an order, or all of an image count together or not at all."""
    return bool(result.protocol.get("scores") != "none")


def text_of(value: float, digits: int) -> str:
    """A value as people read it: ``never`` for what is infinite, a dash for what is undefined."""
    if math.isnan(value):
        return "-"
    return "never" if math.isinf(value) else f"{value:.{digits}f}"


def _reached(n: int | None) -> float:
    return math.inf if n is None else n


def _succinctness(k: int, n_max: int) -> Iterator[Column]:
    def mean_n(method: MethodResult) -> float:
        needed = needed_points(method, k)
        return known_mean(needed[needed <= n_max])

    def auc_deviation(method: MethodResult) -> float:
        return over_repeats_deviation([succinctness(method, k, repeat).auc for repeat in range(method.n_k.shape[1])])

    def failures(method: MethodResult) -> float:
        return float(succinctness(method, k).failures / max(method.n_k.shape[1], 1))

    definition = f"The fewest points per image with which 80 % of the pairs have {k} inliers."
    yield Column("n_at_80", "n at 80 %", definition, 0, -1, lambda method: _reached(succinctness(method, k).n_at_80))
    definition = f"The fewest points per image with which half of the pairs have {k} inliers."
    yield Column("median_n", "median n", definition, 0, -1, lambda method: _reached(succinctness(method, k).median))
    definition = (
        f"Mean of n_{k} over the pairs that get {k} inliers; read it together with the failures, which it leaves out."
    )
    yield Column("mean_n", f"mean n to {k} inliers", definition, 1, -1, mean_n)
    definition = (
        f"Area under the succinctness curve up to {n_max} points, divided by {n_max}: "
        f"1 - {k} / {n_max} = {1 - k / n_max:.3f} at best, 0 when every pair fails. "
        "± is the standard deviation over the repeats of a random verification."
    )
    yield Column("auc", f"AUC-{n_max}", definition, 3, 1, lambda method: succinctness(method, k).auc, auc_deviation)
    definition = f"Pairs without {k} inliers at any n up to {n_max}; the mean over the repeats."
    yield Column("failures", "failures", definition, 1, -1, failures, count=True)


def _judged(k: int, n_max: int) -> Iterator[Column]:
    """Columns of pair sets where the truth about some points is not known."""

    def of(method: MethodResult, repeat: int | None = None) -> SuccinctnessResult:
        return succinctness(method, k, repeat, judged=True)

    def auc_deviation(method: MethodResult) -> float:
        return over_repeats_deviation([of(method, repeat).auc for repeat in range(method.n_k_judged.shape[1])])

    definition = (
        f"The same as n at 80 %, counting judged points only: of the {n_max} best points of each image those whose truth is "
        "not known (no depth, neither their own nor that of a match) are removed, and the rest is matched and verified anew."
    )
    yield Column("n_at_80_judged", "n at 80 %, judged", definition, 0, -1, lambda method: _reached(of(method).n_at_80))
    definition = f"The same as AUC-{n_max}, counting judged points only."
    yield Column("auc_judged", f"AUC-{n_max}, judged", definition, 3, 1, lambda method: of(method).auc, auc_deviation)
    definition = f"Share of the {n_max} best points of both images whose truth is not known; the mean over the pairs."
    yield Column("unknown", "truth unknown", definition, 3, 0, unknown_share)


def _pose(n: int, metres: float, degrees: float) -> Iterator[Column]:
    def auc(errors: Callable[[AtBudget], FloatArray], limit: float) -> tuple[Number, Number]:
        """Pose AUC over all pairs and repeats, and its deviation over the repeats."""

        def deviation(at: AtBudget) -> float:
            return over_repeats_deviation([error_auc(of_repeat, limit) for of_repeat in errors(at).T])

        return _at(n, lambda at: error_auc(errors(at), limit)), _at(n, deviation)

    definition = (
        "Area under the curve of translation errors (Euclidean distance, metres) from 0 to "
        f"{metres:g} m, divided by {metres:g} m: 1 is perfect. A pair without a pose counts as an infinite error; "
        "pairs whose true pose is not known are left out."
    )
    numbers = auc(lambda at: at.translation_error, metres)
    yield Column(f"pose_auc_{metres:g}m", f"pose AUC-{metres:g} m at {n}", definition, 3, 1, *numbers)
    unit = "degree" if degrees == 1 else "degrees"
    definition = f"The same of rotation errors (geodesic angle) from 0 to {degrees:g} {unit}."
    numbers = auc(lambda at: at.rotation_error, degrees)
    yield Column(f"pose_auc_{degrees:g}deg", f"pose AUC-{degrees:g}° at {n}", definition, 3, 1, *numbers)
    definition = (
        f"Pairs without a pose from the {n} best points, though the true one is known; the mean over the repeats. "
        "A table below counts the reasons."
    )
    number = _at(n, lambda at: without_pose(at.outcome))
    yield Column("no_pose", f"no pose at {n}", definition, 1, -1, number, count=True)


def _at_n(n: int) -> Iterator[Column]:
    definition = (
        f"Of the {n} best points of the image that has fewer in the common view, the fraction found again in the other "
        "image. NaN where the true position in the other image is not known."
    )
    number = _at(n, lambda at: known_mean(at.repeatability))
    yield Column("repeatability", f"repeatability at {n}", definition, 3, 1, number)
    definition = f"Of the {n} best points in the common view, the fraction that the descriptor matches correctly."
    number = _at(n, lambda at: known_mean(at.matching_score))
    yield Column("matching_score", f"matching score at {n}", definition, 3, 1, number)
    definition = "Fraction of the cells of a grid over the image that hold an inlier: more is better for the pose."
    yield Column("spread", f"spread at {n}", definition, 3, 1, _at(n, lambda at: known_mean(at.spread)))


def _at(n: int, number: Callable[[AtBudget], float]) -> Number:
    """The number at ``n`` points; points without an order may not have been measured there."""
    return lambda method: number(method.budgets[n]) if n in method.budgets else math.nan


def _ece(n: int) -> Column:
    definition = (
        f"Expected calibration error: mean distance, over the {n} best points, between predicted probability and "
        "frequency of inliers in 20 bins. Only for detectors whose scores are probabilities."
    )

    def ece(method: MethodResult) -> float:
        return method.calibration[n].ece if n in method.calibration else math.nan

    return Column(f"ece_{n}", f"ECE at {n}", definition, 3, -1, ece)


def _covariance(n: int) -> Iterator[Column]:
    def of(method: MethodResult, name: str) -> float:
        return float(getattr(method.covariance[n], name)) if n in method.covariance else math.nan

    definition = (
        f"Of the inlier matches of the {n} best points: mean distance, over probabilities p, between p and the share of "
        "residuals within the ellipses of probability p. Only for detectors that tell covariances of places."
    )
    yield Column("covariance_error", f"covariance error at {n}", definition, 3, -1, lambda method: of(method, "error"))
    definition = "The factor that those covariances need, by maximum likelihood: above 1 they are too small."
    yield Column("covariance_scale", f"needed factor at {n}", definition, 2, 0, lambda method: of(method, "scale"))


def _points(n_max: int) -> Column:
    definition = f"Mean number of points found in an image when {n_max} or more were asked for."

    def points(method: MethodResult) -> float:
        return known_mean(np.concatenate([method.points0, method.points1]))

    return Column("points", "points found", definition, 1, 0, points)


def _stage(stage: str) -> Column:
    definition = f"Mean wall-clock time of {stage} (detect, describe and depth: per image; all others: per pair)."
    return Column(
        f"{stage}_ms", f"{stage}, ms", definition, 1, -1, lambda method: method.milliseconds.get(stage, math.nan)
    )

"""The columns of the table: title, definition, formula and digits of each number in one place, for every output."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

import numpy as np

from sips_lit.evaluate.result import AtBudget, FloatArray, IntArray, MethodResult
from sips_lit.report.column import Column, Number
from sips_lit.report.succinctness_columns import judged_columns, succinctness_columns
from sips_lit.report.summary import (
    error_auc,
    known_mean,
    main_budget,
    main_k,
    over_repeats_deviation,
    pose_limits,
    resampled_error_auc,
    succinctness,
    unknown_share,
    without_pose,
)

OWN_N: Final = "own n only"
"""Tag of methods whose points have no order."""
_STAGES: Final = ("detect", "describe", "depth", "match", "verify", "metrics")


def columns_of(methods: Sequence[MethodResult]) -> list[Column]:
    """The columns of a pair set's table; those without any value are left out."""
    if not methods:
        return []
    first, n = methods[0], main_budget(methods[0])
    timed = {stage for method in methods for stage in method.milliseconds}
    stages = sorted(timed, key=lambda stage: (_STAGES.index(stage) if stage in _STAGES else len(_STAGES), stage))
    budgets = sorted({n for method in methods for n in method.calibration})
    columns = [*succinctness_columns(main_k(first), first.n_max)]
    if any(unknown_share(method) > 0 for method in methods):
        columns += judged_columns(main_k(first), first.n_max)
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


def _pose(n: int, metres: float, degrees: float) -> Iterator[Column]:
    def auc(errors: Callable[[AtBudget], FloatArray], limit: float) -> dict[str, Any]:
        """Pose AUC over all pairs and repeats, its deviation over the repeats, and of draws of the pairs."""

        def deviation(at: AtBudget) -> float:
            return over_repeats_deviation([error_auc(of_repeat, limit) for of_repeat in errors(at).T])

        def resampled(method: MethodResult, drawn: IntArray) -> FloatArray:
            if n not in method.budgets:
                return np.full(len(drawn), np.nan)
            return resampled_error_auc(errors(method.budgets[n]), limit, drawn)

        return {
            "value": _at(n, lambda at: error_auc(errors(at), limit)),
            "deviation": _at(n, deviation),
            "resampled": resampled,
        }

    definition = (
        "Area under the curve of translation errors (Euclidean distance, metres) from 0 to "
        f"{metres:g} m, divided by {metres:g} m: 1 is perfect. A pair without a pose counts as an infinite error; "
        "pairs whose true pose is not known are left out."
    )
    numbers = auc(lambda at: at.translation_error, metres)
    yield Column(f"pose_auc_{metres:g}m", f"pose AUC-{metres:g} m at {n}", definition, 3, 1, **numbers)
    unit = "degree" if degrees == 1 else "degrees"
    definition = f"The same of rotation errors (geodesic angle) from 0 to {degrees:g} {unit}."
    numbers = auc(lambda at: at.rotation_error, degrees)
    yield Column(f"pose_auc_{degrees:g}deg", f"pose AUC-{degrees:g}° at {n}", definition, 3, 1, **numbers)
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

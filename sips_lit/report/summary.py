"""Numbers and curves from what was measured of a method: infinite where it never gets there, NaN where undefined."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.evaluate.result import AtBudget, FloatArray, IntArray, MethodResult, PairTable, PoseOutcome
from sips_lit.metrics.bootstrap import resampled_curves, resampled_mean
from sips_lit.metrics.pose_auc import gains, pose_auc
from sips_lit.metrics.succinctness import SuccinctnessResult, histogram, summarise


def main_k(result: MethodResult) -> int:
    """The k of tables and curves: the protocol's, else the first of those that were measured."""
    asked: int = result.protocol.get("k", result.ks[0])
    return asked if asked in result.ks else result.ks[0]


def main_budget(result: MethodResult) -> int | None:
    """The points per image of tables and pose curves: the protocol's, else the fewest; None if none were asked for."""
    n: int | None = result.protocol.get("n", min(result.budgets, default=None))
    return n


def at_main_budget(results: Sequence[MethodResult]) -> dict[str, AtBudget]:
    """What was measured at the `main_budget` of the first, by the names of the methods that were."""
    n = main_budget(results[0]) if results else None
    return {} if n is None else {result.name: result.budgets[n] for result in results if n in result.budgets}


def needed_points(result: MethodResult, k: int, judged: bool = False) -> FloatArray:
    """n_k (P, R) of each pair and repeat, of all points or of the ``judged`` ones alone; inf where it failed."""
    n_k = result.n_k_judged if judged else result.n_k
    return n_k[:, :, result.ks.index(k)]


def unknown_share(result: MethodResult) -> float:
    """Mean share of the points of a pair whose truth is not known; NaN without any points."""
    return known_mean(result.unknown)


def pose_limits(result: MethodResult) -> tuple[float, float]:
    """Errors up to which pose AUC is measured: metres, degrees. The protocol's, else the paper's 1 m and 1 degree."""
    translation, rotation = (result.protocol.get(f"{error}_limit", 1.0) for error in ("translation", "rotation"))
    return float(translation), float(rotation)


def succinctness(result: MethodResult, k: int, repeat: int | None = None, judged: bool = False) -> SuccinctnessResult:
    """Succinctness for one of ``result.ks``, of one repeat or of all of them pooled; ``judged``: see `needed_points`."""
    needed = needed_points(result, k, judged)
    chosen = needed if repeat is None else needed[:, [repeat]]
    counts = histogram([int(n) if np.isfinite(n) else None for n in chosen.ravel()], result.n_max)
    return summarise(counts, k)


def resampled_succinctness(result: MethodResult, k: int, drawn: IntArray, judged: bool = False) -> FloatArray:
    """The curve of `succinctness` of all repeats for each draw of the pairs ``drawn`` (B, P): (B, n_max + 1)."""
    return resampled_curves(needed_points(result, k, judged), result.n_max, drawn)


def resampled_error_auc(errors: FloatArray, limit: float, drawn: IntArray) -> FloatArray:
    """`error_auc` of errors (P, R) for each draw of the pairs ``drawn`` (B, P): (B,)."""
    gained, known = np.full(errors.shape, np.nan), ~np.isnan(errors)
    gained[known] = gains(errors[known], limit)
    return resampled_mean(gained, drawn)


def error_auc(errors: NDArray[Any], limit: float) -> float:
    """Pose AUC of the errors that are known (not NaN); NaN when none is."""
    return pose_auc(errors[~np.isnan(errors)], limit)


def error_curve(errors: NDArray[Any], limit: float) -> tuple[FloatArray, FloatArray] | None:
    """Steps (x, y) of the fraction of the known errors that are at most x, from 0 to ``limit``; None when none is known."""
    known = np.sort(errors[~np.isnan(errors)])
    if not known.size:
        return None
    within = known[known <= limit]
    x = np.concatenate([[0.0], within, [limit]])
    y = np.concatenate([[0.0], np.arange(1, len(within) + 1), [len(within)]]) / known.size
    return x, y


def median_needed(result: MethodResult, k: int, judged: bool = False) -> FloatArray:
    """`needed_points` (P,) of each pair, the median over the repeats; inf where it failed."""
    return over_repeats(needed_points(result, k, judged))


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


def over_repeats_deviation(values: Sequence[float]) -> float:
    """Standard deviation over the repeats; NaN of one."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")


def without_pose(outcome: IntArray) -> float:
    """How many pairs have no pose though the true one is known, the mean over the repeats; NaN where none is known.

    ``outcome`` (P, R): `sips_lit.evaluate.result.PoseOutcome`.
    """
    known: NDArray[np.bool_] = outcome != PoseOutcome.UNKNOWN
    if not known.any():
        return float("nan")
    return float((known & (outcome != PoseOutcome.FOUND)).sum() / known.shape[1])


def apart(pairs: PairTable) -> str:
    """How far the two frames of a pair are apart, in the median of the pairs, as far as that is known; else nothing."""
    units = {"frames": pairs.gap, "px": pairs.pixels, "m": pairs.translation, "degrees": pairs.rotation}
    medians = {unit: float(np.nanmedian(values)) for unit, values in units.items() if not np.isnan(values).all()}
    return ", ".join(f"{median:.3g} {unit}" for unit, median in medians.items())

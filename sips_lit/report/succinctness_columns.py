"""The columns that say how few points are enough, of all points and of judged ones."""

from __future__ import annotations

import math
from collections.abc import Iterator

from sips_lit.evaluate.result import MethodResult
from sips_lit.metrics.bootstrap import first_reached
from sips_lit.metrics.succinctness import SuccinctnessResult
from sips_lit.report.column import Column, Resampled
from sips_lit.report.summary import (
    known_mean,
    needed_points,
    over_repeats_deviation,
    resampled_succinctness,
    succinctness,
    unknown_share,
)


def succinctness_columns(k: int, n_max: int) -> Iterator[Column]:
    """Columns of all pair sets."""

    def mean_n(method: MethodResult) -> float:
        needed = needed_points(method, k)
        return known_mean(needed[needed <= n_max])

    def auc_deviation(method: MethodResult) -> float:
        return over_repeats_deviation([succinctness(method, k, repeat).auc for repeat in range(method.n_k.shape[1])])

    def failures(method: MethodResult) -> float:
        return float(succinctness(method, k).failures / max(method.n_k.shape[1], 1))

    definition = f"The fewest points per image with which 80 % of the pairs have {k} inliers."
    yield Column(
        "n_at_80",
        "n at 80 %",
        definition,
        0,
        -1,
        lambda method: _reached(succinctness(method, k).n_at_80),
        resampled=_resampled_n(k),
    )
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
    yield Column(
        "auc",
        f"AUC-{n_max}",
        definition,
        3,
        1,
        lambda method: succinctness(method, k).auc,
        auc_deviation,
        resampled=_resampled_auc(k),
    )
    definition = f"Pairs without {k} inliers at any n up to {n_max}; the mean over the repeats."
    yield Column("failures", "failures", definition, 1, -1, failures, count=True)


def _resampled_n(k: int, judged: bool = False) -> Resampled:
    return lambda method, drawn: first_reached(resampled_succinctness(method, k, drawn, judged), 0.8)


def _resampled_auc(k: int, judged: bool = False) -> Resampled:
    return lambda method, drawn: resampled_succinctness(method, k, drawn, judged)[:, :-1].mean(1)


def judged_columns(k: int, n_max: int) -> Iterator[Column]:
    """Columns of pair sets where the truth about some points is not known."""

    def of(method: MethodResult, repeat: int | None = None) -> SuccinctnessResult:
        return succinctness(method, k, repeat, judged=True)

    def auc_deviation(method: MethodResult) -> float:
        return over_repeats_deviation([of(method, repeat).auc for repeat in range(method.n_k_judged.shape[1])])

    definition = (
        f"The same as n at 80 %, counting judged points only: of the {n_max} best points of each image those whose truth is "
        "not known (no depth, neither their own nor that of a match) are removed, and the rest is matched and verified anew."
    )
    yield Column(
        "n_at_80_judged",
        "n at 80 %, judged",
        definition,
        0,
        -1,
        lambda method: _reached(of(method).n_at_80),
        resampled=_resampled_n(k, judged=True),
    )
    definition = f"The same as AUC-{n_max}, counting judged points only."
    yield Column(
        "auc_judged",
        f"AUC-{n_max}, judged",
        definition,
        3,
        1,
        lambda method: of(method).auc,
        auc_deviation,
        resampled=_resampled_auc(k, judged=True),
    )
    definition = f"Share of the {n_max} best points of both images whose truth is not known; the mean over the pairs."
    yield Column("unknown", "truth unknown", definition, 3, 0, unknown_share)


def _reached(n: int | None) -> float:
    return math.inf if n is None else n

"""All figures of a pair set."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.figure import Figure

from sips_lit.evaluate.result import FloatArray, MethodResult, PairSetResult
from sips_lit.render.benchmark_curves import draw_against_k, draw_succinctness_curves
from sips_lit.render.calibration_counts import draw_calibrations
from sips_lit.render.pose_curves import draw_pose_curves
from sips_lit.render.pose_difference import draw_pose_differences
from sips_lit.render.styles import Style
from sips_lit.report.columns import best_first
from sips_lit.report.summary import (
    error_auc,
    error_curve,
    main_budget,
    main_k,
    median_needed,
    pose_limits,
    succinctness,
)

Styles = Mapping[str, Style]
Error = Literal["translation", "rotation"]
_UNITS: dict[Error, str] = {"translation": "m", "rotation": "degree"}


@dataclass(frozen=True, slots=True)
class Chart:
    """A figure with its file name (without suffix), its title and what it shows. ``wide``: it takes the page's width."""

    key: str
    title: str
    caption: str
    figure: Figure
    wide: bool = False


def charts(result: PairSetResult, styles: Styles, legend: bool = True) -> Iterator[Chart]:
    """Every figure that the pair set has numbers for; none without detectors. ``styles`` by the detectors' names."""
    if not result.detectors or not len(result.detectors[0].pairs):
        return
    yield _succinctness(result, styles, legend)
    several = len(result.detectors[0].ks) > 1
    if several:
        yield _auc_by_k(result, styles, legend)
    for error in _UNITS:
        yield from _pose(result, styles, legend, error, several)
    for n in sorted({n for detector in result.detectors for n in detector.calibration}):
        found = {d.name: d.calibration[n] for d in result.detectors if n in d.calibration}
        caption = (
            f"Of the {n} best points of each image: predicted probability against the fraction that are inliers, in 20 "
            "bins, above the number of points in each bin. On the diagonal a probability means what it says."
        )
        yield Chart(f"calibration_{n}", f"Calibration at {n} points", caption, draw_calibrations(found, styles, legend))
    table = result.detectors[0].pairs
    if not np.isnan(table.translation).all():
        yield _pose_differences(result)


def _succinctness(result: PairSetResult, styles: Styles, legend: bool) -> Chart:
    k = main_k(result.detectors[0])
    summaries = {detector.name: succinctness(detector, main_k(detector)) for detector in result.detectors}
    figure = draw_succinctness_curves(
        {name: found.curve for name, found in summaries.items()},
        {name: found.auc for name, found in summaries.items()},
        styles,
        k,
        legend,
    )
    caption = (
        f"Fraction of the pairs that have {k} inliers with the n best points of each image. The grey step is the best "
        "that is possible; the dashed line is 80 % of the pairs."
    )
    return Chart("succinctness", f"Succinctness, k = {k}", caption, figure)


def _auc_by_k(result: PairSetResult, styles: Styles, legend: bool) -> Chart:
    first = result.detectors[0]
    values = {d.name: np.array([succinctness(d, k).auc for k in d.ks]) for d in result.detectors}
    figure = draw_against_k(values, styles, first.ks, f"AUC-{first.n_max}", legend)
    caption = "Area under the succinctness curve for other numbers of inliers."
    return Chart("auc_by_k", f"AUC-{first.n_max} against k", caption, figure)


def _pose(result: PairSetResult, styles: Styles, legend: bool, error: Error, several: bool) -> Iterator[Chart]:
    limit, unit = pose_limits(result.detectors[0])[error == "rotation"], _UNITS[error]
    at_n_k = {d.name: _auc_of_each_k(d, error, limit) for d in result.detectors}
    at_n_k = {name: aucs for name, aucs in at_n_k.items() if not np.isnan(aucs).all()}
    if at_n_k and several:
        figure = draw_against_k(at_n_k, styles, result.detectors[0].ks, f"{error} AUC-{limit:g} {unit} at n_k", legend)
        caption = "Pose from the matches at n_k, that is with just k inliers. A pair without k inliers is a failure."
        yield Chart(f"{error}_auc_by_k", f"{error.title()} AUC against k", caption, figure)
    n = main_budget(result.detectors[0])
    if n is None:
        return
    errors = {d.name: _errors(d, n, error) for d in result.detectors if n in d.budgets}
    curves = {name: curve for name, values in errors.items() if (curve := error_curve(values, limit)) is not None}
    if curves:
        aucs = {name: error_auc(errors[name], limit) for name in curves}
        figure = draw_pose_curves(curves, aucs, styles, limit, f"{error} error, {unit}", legend)
        caption = (
            f"Fraction of the pairs whose {error} error is at most so large, with the {n} best points of each image. "
            "Pairs with fewer inliers than the protocol asks for have no pose and count as infinite."
        )
        yield Chart(f"{error}_error", f"{error.title()} error at {n} points", caption, figure)


def _auc_of_each_k(result: MethodResult, error: Error, limit: float) -> FloatArray:
    errors = result.translation_error if error == "translation" else result.rotation_error
    return np.array([error_auc(errors[:, :, index], limit) for index in range(len(result.ks))])


def _errors(result: MethodResult, n: int, error: Error) -> FloatArray:
    at = result.budgets[n]
    return at.translation_error if error == "translation" else at.rotation_error


def _pose_differences(result: PairSetResult) -> Chart:
    k, table = main_k(result.detectors[0]), result.detectors[0].pairs
    needed = {method.name: median_needed(method, main_k(method)) for method in best_first(result.detectors)}
    caption = (
        f"Each pair at its true translation and rotation; colour and shape tell the points it took for {k} inliers."
    )
    figure = draw_pose_differences(needed, table.translation, table.rotation)
    return Chart("pose_difference", "True pose difference", caption, figure, wide=True)

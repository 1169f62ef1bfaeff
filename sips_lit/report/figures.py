"""All figures of a pair set."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from sips_lit.evaluate.result import MethodResult, PairSetResult
from sips_lit.render.covariance import draw_covariance_reliability
from sips_lit.render.curves import draw_against_k, draw_pose_curves, draw_succinctness_curves
from sips_lit.render.pose_difference import draw_pose_differences
from sips_lit.render.reliability import draw_calibrations
from sips_lit.render.styles import Style
from sips_lit.report.columns import best_first
from sips_lit.report.summary import (
    at_main_budget,
    error_auc,
    error_curve,
    main_k,
    median_needed,
    pose_limits,
    succinctness,
)

Methods = Sequence[MethodResult]
Styles = Mapping[str, Style]
_UNITS: Final = {"translation": "m", "rotation": "degree"}


@dataclass(frozen=True, slots=True)
class Chart:
    """A figure with its file name (without suffix), its title and what it shows. ``wide``: it takes the page's width."""

    key: str
    title: str
    caption: str
    figure: Figure
    wide: bool = False


def charts(result: PairSetResult, styles: Styles, legend: bool = True) -> Iterator[Chart]:
    """Every figure that the pair set has numbers for; none without methods. ``styles`` by the methods' names."""
    methods = result.detectors
    if not methods or not len(methods[0].pairs):
        return
    yield _succinctness(methods, styles, legend)
    if len(methods[0].ks) > 1:
        yield _auc_by_k(methods, styles, legend)
    for error, limit in zip(_UNITS, pose_limits(methods[0]), strict=True):
        if len(methods[0].ks) > 1:
            yield from _pose_by_k(methods, styles, legend, error, limit)
        yield from _pose(methods, styles, legend, error, limit)
    for n in sorted({n for method in methods for n in method.calibration}):
        yield _calibration(methods, styles, legend, n)
    for n in sorted({n for method in methods for n in method.covariance}):
        yield _covariance(methods, n)
    if not np.isnan(methods[0].pairs.translation).all():
        yield _pose_differences(methods)


def _succinctness(methods: Methods, styles: Styles, legend: bool) -> Chart:
    k = main_k(methods[0])
    found = {method.name: succinctness(method, k) for method in methods}
    curves, aucs = ({name: getattr(of, field) for name, of in found.items()} for field in ("curve", "auc"))
    figure = draw_succinctness_curves(curves, aucs, styles, k, legend)
    caption = (
        f"Fraction of the pairs that have {k} inliers with the n best points of each image. The grey step is the best "
        "that is possible; the dashed line is 80 % of the pairs."
    )
    return Chart("succinctness", f"Succinctness, k = {k}", caption, figure)


def _auc_by_k(methods: Methods, styles: Styles, legend: bool) -> Chart:
    first = methods[0]
    values = {method.name: np.array([succinctness(method, k).auc for k in method.ks]) for method in methods}
    figure = draw_against_k(values, styles, first.ks, f"AUC-{first.n_max}", legend)
    caption = "Area under the succinctness curve for other numbers of inliers."
    return Chart("auc_by_k", f"AUC-{first.n_max} against k", caption, figure)


def _pose_by_k(methods: Methods, styles: Styles, legend: bool, error: str, limit: float) -> Iterator[Chart]:
    errors = {method.name: np.moveaxis(getattr(method, f"{error}_error"), 2, 0) for method in methods}
    aucs = {name: np.array([error_auc(of_k, limit) for of_k in by_k]) for name, by_k in errors.items()}
    known = {name: values for name, values in aucs.items() if not np.isnan(values).all()}
    if known:
        ylabel = f"{error} AUC-{limit:g} {_UNITS[error]} at n_k"
        figure = draw_against_k(known, styles, methods[0].ks, ylabel, legend)
        caption = "Pose from the matches at n_k, that is with just k inliers. A pair without k inliers is a failure."
        yield Chart(f"{error}_auc_by_k", f"{error.title()} AUC against k", caption, figure)


def _pose(methods: Methods, styles: Styles, legend: bool, error: str, limit: float) -> Iterator[Chart]:
    measured = at_main_budget(methods)
    errors = {name: getattr(at, f"{error}_error") for name, at in measured.items()}
    curves = {name: curve for name, values in errors.items() if (curve := error_curve(values, limit)) is not None}
    if curves:
        n = next(iter(measured.values())).n
        aucs = {name: error_auc(errors[name], limit) for name in curves}
        figure = draw_pose_curves(curves, aucs, styles, limit, f"{error} error, {_UNITS[error]}", legend)
        caption = (
            f"Fraction of the pairs whose {error} error is at most this large, with the {n} best points of each image. "
            "Pairs with fewer inliers than the protocol asks for have no pose and count as infinite."
        )
        yield Chart(f"{error}_error", f"{error.title()} error at {n} points", caption, figure)


def _calibration(methods: Methods, styles: Styles, legend: bool, n: int) -> Chart:
    found = {method.name: method.calibration[n] for method in methods if n in method.calibration}
    caption = (
        f"Of the {n} best points of each image: predicted probability against the fraction that are inliers, in 20 "
        "bins, above the number of points in each bin. On the diagonal a probability means what it says."
    )
    return Chart(f"calibration_{n}", f"Calibration at {n} points", caption, draw_calibrations(found, styles, legend))


def _covariance(methods: Methods, n: int) -> Chart:
    found = {method.name: method.covariance[n] for method in methods if n in method.covariance}
    caption = (
        f"Of the inlier matches of the {n} best points: the share of residuals within the ellipses of each probability. On "
        "the diagonal the covariances of places are right, below it too small."
    )
    return Chart(f"covariance_{n}", f"Covariances at {n} points", caption, draw_covariance_reliability(found))


def _pose_differences(methods: Methods) -> Chart:
    k, pairs = main_k(methods[0]), methods[0].pairs
    needed = {method.name: median_needed(method, k) for method in best_first(methods)}
    caption = f"Each pair at its true translation and rotation; colour and shape: the points it took for {k} inliers."
    figure = draw_pose_differences(needed, pairs.translation, pairs.rotation)
    return Chart("pose_difference", "True pose difference", caption, figure, wide=True)

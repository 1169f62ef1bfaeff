"""Succinctness and pose curves, of one detector in training and of many in a benchmark, and what becomes of them with k."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from sips_lit.metrics.succinctness import SuccinctnessResult
from sips_lit.render.comparison import draw_comparison
from sips_lit.render.figure import LINE_COLOURS, clean, new_figure
from sips_lit.render.styles import Style

Floats = NDArray[np.float64]


def draw_succinctness(name: str, result: SuccinctnessResult) -> Figure:
    """s(n) of one detector; the grey step is the bound, n_k = k for every pair."""
    figure = new_figure(6.4, 4.2)
    axes = figure.add_subplot()
    clean(axes)
    k, budgets = result.k, np.arange(result.n_max + 1)
    axes.step(budgets, budgets >= k, where="post", color="0.75", linewidth=4, solid_joinstyle="miter", zorder=1)
    axes.annotate(f"k = {k}", (k, 0), xytext=(4, 6), textcoords="offset points", color="0.55", fontsize=9)
    axes.axhline(0.8, color="0.75", linewidth=0.8, linestyle=(0, (6, 4)))
    at_80 = "never 80 %" if result.n_at_80 is None else f"80 % at n = {result.n_at_80}"
    label = f"{name}: AUC {result.auc:.3f}, {at_80}"
    axes.step(budgets, result.curve, where="post", label=label, color=LINE_COLOURS[0])
    axes.set(xlim=(0, result.n_max), ylim=(0, 1.02), xlabel="points extracted per image, n")
    axes.set_ylabel(f"fraction of pairs with {k} inliers, s(n)")
    axes.legend(loc="lower right", fontsize=8.5, framealpha=0.9, edgecolor="0.8")
    return figure


def draw_succinctness_curves(
    curves: Mapping[str, Floats], aucs: Mapping[str, float], styles: Mapping[str, Style], k: int, legend: bool = True
) -> Figure:
    """s(n), (n_max + 1,), of each detector by name, best first; the grey step is the bound, n_k = k for every pair."""
    steps = {name: (np.arange(len(curve)), curve) for name, curve in curves.items()}
    n_max = max((len(curve) - 1 for curve in curves.values()), default=1)
    xlabel, ylabel = "points extracted per image, n", f"fraction of pairs with {k} inliers, s(n)"
    figure = _draw_steps(steps, aucs, styles, legend, xlim=(0, n_max), xlabel=xlabel, ylabel=ylabel)
    (axes,) = figure.axes
    axes.plot([0, k, k, n_max], [0, 0, 1, 1], color="0.8", linewidth=4, solid_joinstyle="miter", zorder=1)
    axes.axhline(0.8, color="0.7", linewidth=0.8, linestyle=(0, (6, 4)), zorder=1)
    return figure


def draw_pose_curves(
    curves: Mapping[str, tuple[Floats, Floats]],
    aucs: Mapping[str, float],
    styles: Mapping[str, Style],
    limit: float,
    error: str,
    legend: bool = True,
) -> Figure:
    """How many pairs have a pose that is at least so good (Cieslewski et al., 3DV 2019, experiments); best AUC first.

    Steps (x, y) of each detector by name: the fraction y of pairs whose error is at most x. ``error`` says which one, with
    its unit. Pairs without a pose hold the curve below 1.
    """
    return _draw_steps(curves, aucs, styles, legend, xlim=(0, limit), xlabel=error, ylabel="fraction of pairs")


def draw_against_k(
    values: Mapping[str, Floats], styles: Mapping[str, Style], ks: Sequence[int], ylabel: str, legend: bool = True
) -> Figure:
    """A value in [0, 1] of each detector by name for each k, (K,); best mean first."""
    order = np.argsort(ks)
    means = {name: known.mean() if (known := value[~np.isnan(value)]).size else -1 for name, value in values.items()}
    curves = {name: (np.asarray(ks)[order], values[name][order]) for name in _best_first(means)}
    labels = {name: name for name in curves}
    return draw_comparison(curves, styles, labels, legend, ylim=(0, 1.02), xlabel="inliers asked for, k", ylabel=ylabel)


def _draw_steps(
    curves: Mapping[str, tuple[ArrayLike, ArrayLike]],
    aucs: Mapping[str, float],
    styles: Mapping[str, Style],
    legend: bool,
    **axes_settings: Any,
) -> Figure:
    """Steps (x, y) with their AUC in the legend, best first."""
    ordered = {name: curves[name] for name in _best_first(aucs)}
    labels = {name: f"{name}  {aucs[name]:.3f}" for name in ordered}
    return draw_comparison(ordered, styles, labels, legend, steps=True, ylim=(0, 1.02), **axes_settings)


def _best_first(values: Mapping[str, float]) -> list[str]:
    return sorted(values, key=lambda name: -np.nan_to_num(values[name], nan=-1))

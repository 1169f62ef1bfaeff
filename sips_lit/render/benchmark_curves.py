"""Succinctness curves of many detectors, and what becomes of them as k grows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sips_lit.render.comparison import draw_comparison
from sips_lit.render.styles import Style


def draw_succinctness_curves(
    curves: Mapping[str, NDArray[np.float64]],
    aucs: Mapping[str, float],
    styles: Mapping[str, Style],
    k: int,
    legend: bool = True,
) -> Figure:
    """s(n), (n_max + 1,), of each detector by name, best first; the grey step is the bound, n_k = k for every pair."""
    best_first = sorted(curves, key=lambda name: -np.nan_to_num(aucs[name], nan=-1))
    n_max = max((len(curve) - 1 for curve in curves.values()), default=1)
    figure = draw_comparison(
        {name: (np.arange(len(curves[name])), curves[name]) for name in best_first},
        styles,
        {name: f"{name}  {aucs[name]:.3f}" for name in best_first},
        legend,
        steps=True,
        xlim=(0, n_max),
        ylim=(0, 1.02),
        xlabel="points extracted per image, n",
        ylabel=f"fraction of pairs with {k} inliers, s(n)",
    )
    (axes,) = figure.axes
    axes.plot([0, k, k, n_max], [0, 0, 1, 1], color="0.8", linewidth=4, solid_joinstyle="miter", zorder=1)
    axes.axhline(0.8, color="0.7", linewidth=0.8, linestyle=(0, (6, 4)), zorder=1)
    return figure


def draw_against_k(
    values: Mapping[str, NDArray[np.float64]],
    styles: Mapping[str, Style],
    ks: Sequence[int],
    ylabel: str,
    legend: bool = True,
) -> Figure:
    """A value in [0, 1] of each detector by name for each k, (K,); best mean first."""
    order = np.argsort(ks)
    means = {name: known.mean() if (known := value[~np.isnan(value)]).size else -1 for name, value in values.items()}
    best_first = sorted(values, key=lambda name: -means[name])
    return draw_comparison(
        {name: (np.asarray(ks)[order], values[name][order]) for name in best_first},
        styles,
        {name: name for name in best_first},
        legend,
        ylim=(0, 1.02),
        xlabel="inliers asked for, k",
        ylabel=ylabel,
    )

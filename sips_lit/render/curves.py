"""Succinctness curves of several detectors in one figure."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle

import numpy as np
from matplotlib.figure import Figure

from sips_lit.metrics.succinctness import SuccinctnessResult
from sips_lit.render.figure import LINE_COLOURS, clean, new_figure


def draw_succinctness(results: Mapping[str, SuccinctnessResult]) -> Figure:
    """s(n) of each detector by name, best first in the legend; the grey step is the bound, n_k = k for every pair.

    Raises ValueError when there is nothing to draw, or when the results differ in k or n_max and so cannot be compared.
    """
    protocols = {(result.k, result.n_max) for result in results.values()}
    if len(protocols) != 1:
        found = ", ".join(f"k = {k} with n_max = {n_max}" for k, n_max in sorted(protocols)) or "no results"
        raise ValueError(f"succinctness curves need one k and one n_max, not {found}")
    k, n_max = protocols.pop()
    figure = new_figure(6.4, 4.2)
    axes = figure.add_subplot()
    clean(axes)
    budgets = np.arange(n_max + 1)
    axes.step(budgets, budgets >= k, where="post", color="0.75", linewidth=4, solid_joinstyle="miter", zorder=1)
    axes.annotate(f"k = {k}", (k, 0), xytext=(4, 6), textcoords="offset points", color="0.55", fontsize=9)
    axes.axhline(0.8, color="0.75", linewidth=0.8, linestyle=(0, (6, 4)))

    best_first = sorted(results.items(), key=lambda item: -np.nan_to_num(item[1].auc, nan=-1))
    styles = zip(cycle(LINE_COLOURS), (style for style in cycle(("-", "--", ":", "-.")) for _ in LINE_COLOURS))
    for (name, result), (colour, style) in zip(best_first, styles, strict=False):
        axes.step(budgets, result.curve, where="post", label=_label(name, result), color=colour, linestyle=style)
    axes.set(xlim=(0, n_max), ylim=(0, 1.02), xlabel="points extracted per image, n")
    axes.set_ylabel(f"fraction of pairs with {k} inliers, s(n)")
    axes.legend(loc="lower right", fontsize=8.5, framealpha=0.9, edgecolor="0.8")
    return figure


def _label(name: str, result: SuccinctnessResult) -> str:
    at_80 = "never 80 %" if result.n_at_80 is None else f"80 % at n = {result.n_at_80}"
    return f"{name}: AUC {result.auc:.3f}, {at_80}"

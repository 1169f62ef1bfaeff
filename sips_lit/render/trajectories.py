"""Trajectories from above, and an error against the number of points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from sips_lit.render.comparison import ENTRY_HEIGHT, LEGEND_WIDTH, draw_curve, new_chart, put_legend
from sips_lit.render.figure import clean, new_figure
from sips_lit.render.styles import Style
from sips_lit.types import FloatArray

PANEL = 3.4  # inches a side
SMALLEST = 1e-3  # metres from the middle of a picture to its side: a camera may stand still
AXES = "xyz"


def draw_trajectories(
    panels: Mapping[str, Mapping[str, FloatArray]], truth: FloatArray | None, styles: Mapping[str, Style]
) -> Figure:
    """Places (N, 3) of each method by name, a panel per title, above the true ones (N, 3), if known, in grey.

    The two axes of the world along which the (true) path reaches furthest: from above for a car, the larger side for a hand.
    What goes astray leaves the picture, which is half as large again as the true path needs.
    """
    shown = next(iter(next(iter(panels.values())).values())) if truth is None else truth
    low, high = np.nanmin(shown, 0), np.nanmax(shown, 0)
    across, up = sorted(np.argsort(low - high)[:2])
    names = list(dict.fromkeys(name for panel in panels.values() for name in panel))
    height = max(PANEL + 0.4, ENTRY_HEIGHT * (len(names) + 1) + 0.8)
    figure = new_figure(PANEL * len(panels) + LEGEND_WIDTH, height)
    every = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (title, curves) in zip(every, panels.items(), strict=True):
        clean(axes)
        if truth is not None:
            axes.plot(truth[:, across], truth[:, up], color="0.75", linewidth=4, label="true", solid_capstyle="round")
        for name, places in curves.items():
            draw_curve(axes, places[:, across], places[:, up], styles[name], name)
        axes.set(title=title, xlabel=f"{AXES[across]} (m)", aspect="equal")
        axes.set_adjustable("datalim" if truth is None else "box")  # with limits of its own a panel is a square
        if truth is not None:
            half = max(0.75 * float((high - low).max()), SMALLEST)
            middle = (low + high) / 2
            axes.set(xlim=middle[across] + np.array([-half, half]), ylim=middle[up] + np.array([-half, half]))
    every[0].set_ylabel(f"{AXES[up]} (m)")
    put_legend(every[-1])
    return figure


def draw_against_n(
    values: Mapping[str, tuple[FloatArray, FloatArray]], ns: Sequence[int], styles: Mapping[str, Style], ylabel: str
) -> Figure:
    """Mean and deviation (N,) of each method by name for each number of points, both axes logarithmic."""
    figure = new_chart(len(values), True)
    axes = figure.add_subplot()
    clean(axes)
    for name, (mean, deviation) in values.items():
        draw_curve(axes, ns, mean, styles[name], name)
        axes.errorbar(ns, mean, deviation, fmt="o", markersize=3, color=styles[name].colour, linewidth=1)
    axes.set(xscale="log", yscale="log", xlabel="points per frame, n", ylabel=ylabel)
    axes.set_xticks(list(ns), [str(n) for n in ns])
    axes.minorticks_off()
    put_legend(axes)
    return figure

"""Curves of many detectors in one chart that stays legible."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from sips_lit.render.figure import clean, new_figure
from sips_lit.render.styles import Style, literal

WIDTH, HEIGHT, LEGEND_WIDTH, ENTRY_HEIGHT = 5.4, 3.8, 2.6, 0.175  # inches


def new_chart(entries: int, legend: bool, height: float = HEIGHT) -> Figure:
    """A figure with room for a legend of so many entries on its right, if there is to be one."""
    if not legend:
        return new_figure(WIDTH, height)
    return new_figure(WIDTH + LEGEND_WIDTH, max(height, ENTRY_HEIGHT * entries + 0.8))


def draw_comparison(
    curves: Mapping[str, tuple[ArrayLike, ArrayLike]],
    styles: Mapping[str, Style],
    labels: Mapping[str, str],
    legend: bool = True,
    steps: bool = False,
    **axes_settings: Any,
) -> Figure:
    """A curve (x, y) of each detector by name, in the legend in this order with its label; the legend stands outside.

    With ``steps`` a value holds until the next x. Each line's id in an SVG file is ``curve-<index of its style>``.
    """
    figure = new_chart(len(curves), legend)
    axes = figure.add_subplot()
    clean(axes)
    for name, (x, y) in curves.items():
        draw_curve(axes, x, y, styles[name], labels[name], steps)
    axes.set(**axes_settings)
    if legend:
        put_legend(axes)
    return figure


def draw_curve(axes: Axes, x: ArrayLike, y: ArrayLike, style: Style, label: str, steps: bool = False) -> None:
    """One detector's line; markers, where the style has one, are few so that they do not hide it."""
    (line,) = axes.plot(
        x,
        y,
        label=literal(label),
        color=style.colour,
        linestyle=style.line,
        linewidth=1.4,
        marker=style.marker or None,
        markersize=4,
        markevery=(0.04, 0.15),
        drawstyle="steps-post" if steps else "default",
    )
    line.set_gid(f"curve-{style.index}")


def put_legend(axes: Axes) -> None:
    """The legend to the right of the axes, top-aligned."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1), fontsize=8, frameon=False, handlelength=2.6)

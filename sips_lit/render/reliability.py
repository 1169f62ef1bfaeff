"""Reliability diagrams: predicted probability against the frequency of inliers, above how many points say so."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sips_lit.metrics.calibration import CalibrationResult
from sips_lit.render.comparison import draw_curve, new_chart, put_legend
from sips_lit.render.figure import LINE_COLOURS, clean, new_figure
from sips_lit.render.styles import Style


def draw_reliability(result: CalibrationResult) -> Figure:
    """A bar for each bin's inlier frequency with its 95 % interval, above the counts.

    Bars on the diagonal are well calibrated; a dot stands at the bin's mean probability. Empty bins stay empty.
    """
    figure = new_figure(5.0, 5.6)
    upper, lower = _panels(figure, max(10, int(result.count.max())), "0.55", zorder=3)
    filled = result.count > 0
    left, width = result.edges[:-1][filled], np.diff(result.edges)[filled]
    score, frequency, count = result.mean_score[filled], result.frequency[filled], result.count[filled]

    upper.bar(left, frequency, width, align="edge", color=LINE_COLOURS[4], edgecolor="white", linewidth=0.8, alpha=0.6)
    low, high = _wilson(frequency, count)
    spread = np.maximum([frequency - low, high - frequency], 0)  # rounding
    upper.errorbar(score, frequency, spread, fmt="o", color=LINE_COLOURS[0], markersize=3.5, linewidth=1.1, zorder=4)
    upper.set_title(f"ECE {result.ece:.3f}, MCE {result.mce:.3f}, Brier {result.brier:.3f}", fontsize=11)

    lower.bar(left, count, width, align="edge", color="0.6", edgecolor="white", linewidth=0.8)
    lower.set_ylabel(f"points ({result.points:,})")
    return figure


def draw_calibrations(
    results: Mapping[str, CalibrationResult], styles: Mapping[str, Style], legend: bool = True
) -> Figure:
    """Of several detectors a dot for each bin that holds points, at its mean probability, best ECE first.

    The counts below are a step a bin; empty bins have no dot.
    """
    figure = new_chart(len(results), legend, height=4.8)
    most = max([10, *(int(result.count.max()) for result in results.values())])
    upper, lower = _panels(figure, most, "0.7", zorder=1)
    for name, result in sorted(results.items(), key=lambda item: item[1].ece if item[1].points else 2):
        style, filled = styles[name], result.count > 0
        draw_curve(upper, result.mean_score[filled], result.frequency[filled], style, f"{name}  {result.ece:.3f}")
        upper.lines[-1].set(marker=style.marker or "o", markevery=1, markersize=3.5)
        count = [*result.count, result.count[-1]]  # the last step ends at the last edge
        draw_curve(lower, result.edges, count, style, name, steps=True)
        lower.lines[-1].set_marker("")
    if legend:
        put_legend(upper)
    return figure


def _panels(figure: Figure, most: int, grey: str, zorder: int) -> tuple[Axes, Axes]:
    """Frequencies, where the diagonal is perfect, above counts of up to ``most`` points on a log scale."""
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    clean(upper)
    clean(lower)
    upper.plot([0, 1], [0, 1], color=grey, linewidth=1, linestyle=(0, (6, 4)), zorder=zorder)
    upper.set(xlim=(0, 1), ylim=(0, 1), ylabel="frequency of inliers")
    lower.set(ylim=(0.7, 2 * most), yscale="log", xlabel="predicted probability of being an inlier", ylabel="points")
    return upper, lower


def _wilson(
    frequency: NDArray[np.float64], count: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """95 % interval of a frequency seen in ``count`` trials (Wilson, 1927): it holds for few trials, too."""
    z = 1.96
    centre = (frequency + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z / (1 + z**2 / count) * np.sqrt(frequency * (1 - frequency) / count + (z / (2 * count)) ** 2)
    return centre - half, centre + half

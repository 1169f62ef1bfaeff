"""Reliability diagram: predicted probability against the frequency of inliers, and how many points say so."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sips_lit.metrics.calibration import CalibrationResult
from sips_lit.render.figure import LINE_COLOURS, clean, new_figure


def draw_reliability(result: CalibrationResult) -> Figure:
    """A bar for each bin's inlier frequency with its 95 % interval, above the counts on a log scale.

    Bars on the diagonal are well calibrated; a dot stands at the bin's mean probability. Empty bins stay empty.
    """
    figure = new_figure(5.0, 5.6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    filled = result.count > 0
    left, width = result.edges[:-1][filled], np.diff(result.edges)[filled]
    score, frequency, count = result.mean_score[filled], result.frequency[filled], result.count[filled]

    clean(upper)
    upper.plot([0, 1], [0, 1], color="0.55", linewidth=1, linestyle=(0, (6, 4)), zorder=3)
    upper.bar(left, frequency, width, align="edge", color=LINE_COLOURS[4], edgecolor="white", linewidth=0.8, alpha=0.6)
    low, high = _wilson(frequency, count)
    spread = np.maximum([frequency - low, high - frequency], 0)  # rounding
    upper.errorbar(score, frequency, spread, fmt="o", color=LINE_COLOURS[0], markersize=3.5, linewidth=1.1, zorder=4)
    upper.set(xlim=(0, 1), ylim=(0, 1), ylabel="frequency of inliers")
    upper.set_title(f"ECE {result.ece:.3f}, MCE {result.mce:.3f}, Brier {result.brier:.3f}", fontsize=11)

    clean(lower)
    lower.bar(left, count, width, align="edge", color="0.6", edgecolor="white", linewidth=0.8)
    lower.set_yscale("log")
    lower.set_ylim(0.7, 2 * max(10, result.count.max()))
    lower.set(xlabel="predicted probability of being an inlier", ylabel=f"points ({result.points:,})")
    return figure


def _wilson(
    frequency: NDArray[np.float64], count: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """95 % interval of a frequency seen in ``count`` trials (Wilson, 1927): it holds for few trials, too."""
    z = 1.96
    centre = (frequency + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z / (1 + z**2 / count) * np.sqrt(frequency * (1 - frequency) / count + (z / (2 * count)) ** 2)
    return centre - half, centre + half

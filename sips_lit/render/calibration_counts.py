"""Predicted probability against inlier frequency of several detectors, above how many points say so."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from sips_lit.metrics.calibration import CalibrationResult
from sips_lit.render.comparison import draw_curve, new_chart, put_legend
from sips_lit.render.figure import clean
from sips_lit.render.styles import Style


def draw_calibrations(
    results: Mapping[str, CalibrationResult], styles: Mapping[str, Style], legend: bool = True
) -> Figure:
    """A dot for each bin that holds points, at its mean probability; the diagonal is perfect. Best ECE first.

    The counts below are on a log scale, a step a bin; empty bins have no dot.
    """
    figure = new_chart(len(results), legend, height=4.8)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    clean(upper)
    clean(lower)
    upper.plot([0, 1], [0, 1], color="0.7", linewidth=1, linestyle=(0, (6, 4)), zorder=1)
    most = 10
    for name, result in sorted(results.items(), key=lambda item: item[1].ece if item[1].points else 2):
        style, filled = styles[name], result.count > 0
        draw_curve(upper, result.mean_score[filled], result.frequency[filled], style, f"{name}  {result.ece:.3f}")
        upper.lines[-1].set(marker=style.marker or "o", markevery=1, markersize=3.5)
        count = [*result.count, result.count[-1]]  # the last step ends at the last edge
        draw_curve(lower, result.edges, count, style, name, steps=True)
        lower.lines[-1].set_marker("")
        most = max(most, int(result.count.max()))
    upper.set(xlim=(0, 1), ylim=(0, 1), ylabel="frequency of inliers")
    lower.set(ylim=(0.7, 2 * most), yscale="log", xlabel="predicted probability of being an inlier", ylabel="points")
    if legend:
        put_legend(upper)
    return figure

"""Pictures of a recalibration: reliability before and after, and asked against observed coverage of budgets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sips_lit.metrics.calibration import CalibrationResult
from sips_lit.metrics.coverage import Coverage
from sips_lit.render.figure import LINE_COLOURS, clean, new_figure
from sips_lit.render.styles import literal

BEFORE, AFTER = LINE_COLOURS[1], LINE_COLOURS[0]


def draw_recalibration(
    reliability: Mapping[str, tuple[CalibrationResult, CalibrationResult]],
    coverages: Mapping[str, tuple[Sequence[Coverage], Sequence[Coverage]]],
) -> Figure:
    """A column for each data set: above, the frequency of inliers in each bin that holds points; below, coverage.

    Both before and after; the area of a dot grows with its share of the points. On the diagonal all is as promised.
    """
    columns = max(1, len(reliability))
    figure = new_figure(0.6 + 3.1 * columns, 6.2)
    grid = figure.subplots(2, columns, squeeze=False, sharex=True, sharey=True)
    for axes in grid.flat:
        clean(axes)
        axes.plot([0, 1], [0, 1], color="0.7", linewidth=1, linestyle=(0, (6, 4)), zorder=1)
        axes.set(xlim=(0, 1), ylim=(0, 1))
        axes.set_aspect("equal")
    for column, (name, results) in enumerate(reliability.items()):
        upper, lower = grid[:, column]
        for label, colour, result in zip(("before", "after"), (BEFORE, AFTER), results, strict=True):
            _bins(upper, result, f"{label}: ECE {result.ece:.3f}", colour)
        for label, colour, found in zip(("before", "after"), (BEFORE, AFTER), coverages[name], strict=True):
            lower.plot(
                [c.asked for c in found], [c.observed for c in found], "o-", color=colour, label=label, markersize=4
            )
        upper.set_title(literal(name), fontsize=10)
        upper.set_xlabel("probability of being an inlier", fontsize=9)
        lower.set_xlabel("probability of k inliers asked for", fontsize=9)
        upper.legend(loc="upper left", fontsize=8, frameon=False)
        lower.legend(loc="upper left", fontsize=8, frameon=False)
    grid[0, 0].set_ylabel("frequency of inliers", fontsize=9)
    grid[1, 0].set_ylabel("frequency of k inliers", fontsize=9)
    return figure


def _bins(axes: Axes, result: CalibrationResult, label: str, colour: str) -> None:
    filled = result.count > 0
    share = result.count[filled] / max(1, result.points)
    axes.plot(result.mean_score[filled], result.frequency[filled], color=colour, linewidth=1.2, label=label)
    axes.scatter(result.mean_score[filled], result.frequency[filled], s=4 + 160 * share, color=colour, zorder=3)

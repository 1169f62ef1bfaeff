"""Reliability of covariances as a picture: the share of residuals within each ellipse against the probability it claims."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from sips_lit.metrics.covariance import CovarianceReliability
from sips_lit.render.figure import LINE_COLOURS, clean, new_figure


def draw_covariance_reliability(results: Mapping[str, CovarianceReliability]) -> Figure:
    """A curve for each set of residuals, by its name; on the diagonal covariances are right, below it too small."""
    figure = new_figure(5.0, 4.8)
    axes = figure.subplots()
    clean(axes)
    axes.plot([0, 1], [0, 1], color="0.55", linewidth=1, linestyle=(0, (6, 4)))
    for index, (name, result) in enumerate(results.items()):
        label = f"{name}: error {result.error:.3f}, needed factor {result.scale:.2f} ({result.residuals:,} residuals)"
        axes.plot(
            result.edges,
            result.within,
            color=LINE_COLOURS[index % len(LINE_COLOURS)],
            marker="o",
            markersize=3,
            label=label,
        )
    axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="probability of the ellipse", ylabel="share of residuals within it")
    axes.legend(loc="upper left", fontsize=8, frameon=False)
    return figure

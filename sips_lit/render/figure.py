"""Plots without pyplot: figures that belong to their maker, so that threads do not meet and nothing need be closed."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sips_lit.render.canvas import Picture

# After Okabe and Ito: distinct for colour-blind eyes, too.
LINE_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of so many inches, at 150 dots each."""
    figure = Figure(figsize=(width, height), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def clean(axes: Axes) -> None:
    """Take away the frame and put a faint grid beneath the data."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)


def figure_to_array(figure: Figure) -> Picture:
    """The figure as RGB uint8 (H, W, 3), for a PNG or a logger."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]  # matplotlib types its canvas only in part
    rgba = np.asarray(canvas.buffer_rgba(), np.uint8)  # type: ignore[no-untyped-call]  # as above
    return rgba[:, :, :3].copy()

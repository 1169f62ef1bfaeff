"""Which true motions between the two views a detector copes with (Cieslewski et al., 3DV 2019, supplement)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sips_lit.render.figure import clean, new_figure
from sips_lit.render.styles import literal

Floats = NDArray[np.float64]


_BANDS = (
    ("n < 50", -1, 49, "#56B4E9", "o"),
    ("50 to 100", 49, 100, "#E69F00", "s"),
    ("> 100", 100, 1e9, "#D55E00", "^"),
    ("failed", 1e9, np.inf, "#000000", "x"),
)
"""Label, points above and up to, colour and marker: light to dark and of different shapes, to tell them without colours."""


def draw_pose_differences(needed: Mapping[str, Floats], translation: Floats, rotation: Floats) -> Figure:
    """A panel a detector by name: a mark for each of P pairs at its true translation (m) and rotation (degrees).

    Colour and shape tell ``needed[name]`` (P,), the points it took, inf = failed. Pairs with an unknown pose are left out.
    """
    across = min(4, max(2, len(needed)))
    down = max(1, -(-len(needed) // across))
    figure = new_figure(1.9 * across, 1.75 * down + 0.6)
    grid = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, (name, points) in zip(grid, needed.items(), strict=False):
        clean(axes)
        axes.set_title(literal(name), fontsize=8, loc="left")
        axes.tick_params(labelsize=7)
        for label, above, up_to, colour, marker in _BANDS:
            chosen = (points > above) & (points <= up_to)
            x, y = translation[chosen], rotation[chosen]
            axes.scatter(x, y, s=11, c=colour, marker=marker, linewidths=0.8, label=label)
    for axes in grid[len(needed) :]:
        axes.set_axis_off()
    figure.supxlabel("true translation, m", fontsize=9)
    figure.supylabel("true rotation, degrees", fontsize=9)
    handles, labels = grid[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=8, frameon=False)
    return figure

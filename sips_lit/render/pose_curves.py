"""How many pairs have a pose that is at least so good (Cieslewski et al., 3DV 2019, experiments)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sips_lit.render.comparison import draw_comparison
from sips_lit.render.styles import Style


def draw_pose_curves(
    curves: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]],
    aucs: Mapping[str, float],
    styles: Mapping[str, Style],
    limit: float,
    error: str,
    legend: bool = True,
) -> Figure:
    """Steps (x, y) of each detector by name: the fraction y of pairs whose error is at most x; best AUC first.

    ``error`` says which one, with its unit. Pairs without a pose hold the curve below 1.
    """
    best_first = sorted(curves, key=lambda name: -aucs[name])
    return draw_comparison(
        {name: curves[name] for name in best_first},
        styles,
        {name: f"{name}  {aucs[name]:.3f}" for name in best_first},
        legend,
        steps=True,
        xlim=(0, limit),
        ylim=(0, 1.02),
        xlabel=error,
        ylabel="fraction of pairs",
    )

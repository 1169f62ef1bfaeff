"""Non-maximum suppression with an exact radius and deterministic ties."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor


def local_maxima(scores: Tensor, radius: int) -> tuple[Tensor, Tensor]:
    """Rows and columns, each (N,) int64, of the local maxima of a score map (H, W), best first.

    A pixel is a maximum if no pixel within Chebyshev distance ``radius`` scores higher, and is kept if no equal maximum
    within that distance comes earlier in raster order. So no two kept pixels are closer than or equal to ``radius``, and
    equal scores give the same points on every machine.
    Kept pixels are ordered by score, then row, then column. Pixels that are NaN or -inf are never kept.
    """
    candidates = (scores == _window_max(scores, radius)) & (scores > -torch.inf)
    rows, columns = torch.nonzero(candidates, as_tuple=True)
    values = scores[rows, columns]
    order = torch.sort(values, descending=True, stable=True).indices  # nonzero() is in raster order
    values = values[order]
    if bool((values[1:] == values[:-1]).any()):
        return _break_ties(scores, candidates, radius)
    return rows[order], columns[order]


def _break_ties(scores: Tensor, candidates: Tensor, radius: int) -> tuple[Tensor, Tensor]:
    """Candidates within ``radius`` of each other have equal scores: keep those that come first in raster order."""
    height, width = scores.shape
    earliness = -torch.arange(height * width, device=scores.device, dtype=torch.float64).reshape(height, width)
    earliness = earliness.masked_fill(~candidates, -torch.inf)
    rows, columns = torch.nonzero(candidates & (earliness == _window_max(earliness, radius)), as_tuple=True)
    order = torch.sort(scores[rows, columns], descending=True, stable=True).indices
    return rows[order], columns[order]


def _window_max(x: Tensor, radius: int) -> Tensor:
    """Maximum over the (2 radius + 1)^2 window around each element of (H, W); NaN counts as -inf."""
    x = torch.nan_to_num(x, nan=-torch.inf, posinf=torch.inf, neginf=-torch.inf)
    return _row_max(_row_max(x, radius).T, radius).T


def _row_max(x: Tensor, radius: int) -> Tensor:
    """Sliding maximum along the rows by doubling the span: log2(window) passes, far faster than max-pooling."""
    window, span = 2 * radius + 1, 1
    x = F.pad(x, (radius, radius), value=-torch.inf)
    while span < window:
        step = min(span, window - span)
        x = torch.maximum(x[:, :-step], x[:, step:])
        span += step
    return x

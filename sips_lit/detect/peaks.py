"""Peaks of a score map: non-maximum suppression with an exact radius and deterministic ties, and a sub-pixel fit."""

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
    rows, columns = _best_first(scores, candidates)
    values = scores[rows, columns]
    if bool((values[1:] == values[:-1]).any()):
        # candidates within the radius of each other have equal scores: keep those that come first in raster order
        earliness = -torch.arange(scores.numel(), device=scores.device, dtype=torch.float64).reshape(scores.shape)
        earliness = earliness.masked_fill(~candidates, -torch.inf)
        rows, columns = _best_first(scores, candidates & (earliness == _window_max(earliness, radius)))
    return rows, columns


def quadratic_offsets(scores: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    """Offsets (N, 2) as (dx, dy) from each peak pixel to the top of the quadratic through its 3x3 neighbourhood.

    Fit on logits, not on probabilities: the sigmoid flattens strong peaks. Gradient and Hessian are central differences;
    the step is Newton's, cut to half a pixel. It is zero where the neighbourhood has no proper top (the Hessian is not
    negative definite, or a value is not finite) and at the border of the map (H, W).
    """
    height, width = scores.shape
    inside = (rows > 0) & (rows < height - 1) & (columns > 0) & (columns < width - 1)
    r, c = rows.clamp(1, max(1, height - 2)), columns.clamp(1, max(1, width - 2))
    if height < 3 or width < 3:
        return torch.zeros(len(rows), 2, dtype=scores.dtype, device=scores.device)

    def at(dy: int, dx: int) -> Tensor:
        return scores[r + dy, c + dx].double()

    gx, gy = (at(0, 1) - at(0, -1)) / 2, (at(1, 0) - at(-1, 0)) / 2
    xx, yy = at(0, 1) - 2 * at(0, 0) + at(0, -1), at(1, 0) - 2 * at(0, 0) + at(-1, 0)
    xy = (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1)) / 4
    determinant = xx * yy - xy * xy
    step = torch.stack([xy * gy - yy * gx, xy * gx - xx * gy], 1) / determinant.unsqueeze(1)
    proper = inside & (xx < 0) & (determinant > 0) & torch.isfinite(step).all(1)
    return torch.where(proper.unsqueeze(1), step.clamp(-0.5, 0.5), torch.zeros_like(step)).to(scores.dtype)


def _best_first(scores: Tensor, chosen: Tensor) -> tuple[Tensor, Tensor]:
    rows, columns = torch.nonzero(chosen, as_tuple=True)  # in raster order
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

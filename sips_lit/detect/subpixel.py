"""Sub-pixel peaks by a quadratic fit."""

from __future__ import annotations

import torch
from torch import Tensor


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

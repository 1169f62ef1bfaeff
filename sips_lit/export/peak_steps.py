"""The steps from logits to points on batches, with shapes that depend on the image's size alone, as exported graphs need.

`sips_lit.detect.peaks` is the same for one image: it leaves out what an image does not need, which a graph can't.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from sips_lit.detect.selection import far_from_border


def peak_pixels(logits: Tensor, radius: int) -> Tensor:
    """Pixels (B, P) int64, row W + column, of the local maxima of score maps (B, H, W), ascending; the rest is H W.

    They are those of `local_maxima`. A square with a side of ``radius`` + 1 pixels holds at most one of them, so P is the
    number of such squares, and what follows sorts few numbers.
    """
    height, width = logits.shape[-2:]
    maxima = logits == _window_max(logits, radius, -torch.inf)
    # maxima within the radius of each other are equal: the first in raster order stays
    earliness = height * width - torch.arange(height * width, dtype=torch.int32, device=logits.device)
    earliness = torch.where(maxima, earliness.reshape(height, width), 0)
    kept = maxima & (earliness == _window_max(earliness, radius, 0))

    side = radius + 1
    rows, columns = (torch.arange(size, device=logits.device) % side for size in (height, width))
    place = 1 + rows[:, None] * side + columns  # within the square; a number that float32 holds exactly in any image
    place = _square_max(torch.where(kept, place, 0).to(logits.dtype), side).long()
    down, across = (torch.arange(size, device=logits.device) for size in place.shape[-2:])
    row = side * down[:, None] + (place - 1) // side
    pixel = row * width + side * across + (place - 1) % side
    return torch.where(place > 0, pixel, height * width).flatten(1).sort(dim=1).values


def best_pixels(logits: Tensor, pixels: Tensor, n: int, border: int = 0) -> tuple[Tensor, Tensor, Tensor]:
    """Logits (B, n), rows and columns (B, n) int64 of the best of `peak_pixels`, equal ones by row, then column.

    Of those that are `far_from_border`. Where there are fewer, the logits that are left are -inf, and the pixels are in the
    first row.
    """
    height, width = logits.shape[-2:]
    found = pixels < height * width
    if border:
        rows = pixels // width
        found = found & far_from_border(rows, pixels - rows * width, (height, width), border)
    found = F.pad(found, (0, n))
    pixels = torch.where(found, F.pad(pixels, (0, n)), 0)
    value = torch.where(found, logits.flatten(1).gather(1, pixels), -torch.inf)
    value, order = value.sort(dim=1, descending=True, stable=True)
    pixels = pixels.gather(1, order[:, :n])
    rows = pixels // width
    return value[:, :n], rows, pixels - rows * width


def fitted_offsets(logits: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    """`quadratic_offsets` (B, n, 2) of the pixels (B, n) of each of the maps (B, H, W)."""
    height, width = logits.shape[-2:]
    around = F.pad(logits, (1, 1, 1, 1)).flatten(1)

    def at(dy: int, dx: int) -> Tensor:
        return around.gather(1, (rows + 1 + dy) * (width + 2) + columns + 1 + dx).double()

    gx, gy = (at(0, 1) - at(0, -1)) / 2, (at(1, 0) - at(-1, 0)) / 2
    xx, yy = at(0, 1) - 2 * at(0, 0) + at(0, -1), at(1, 0) - 2 * at(0, 0) + at(-1, 0)
    xy = (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1)) / 4
    determinant = xx * yy - xy * xy
    step = torch.stack([xy * gy - yy * gx, xy * gx - xx * gy], -1) / determinant.unsqueeze(-1)
    inside = (rows > 0) & (rows < height - 1) & (columns > 0) & (columns < width - 1)
    finite = (step.abs() < torch.inf).all(-1)
    proper = inside & (xx < 0) & (determinant > 0) & finite
    return torch.where(proper.unsqueeze(-1), step.clamp(-0.5, 0.5), 0.0).to(logits.dtype)


def _window_max(x: Tensor, radius: int, outside: float) -> Tensor:
    """Maximum (B, H, W) over the (2 radius + 1)^2 window around each element, by doubling the span."""
    window, span = 2 * radius + 1, 1
    x = F.pad(x, (radius,) * 4, value=outside)
    while span < window:
        step = min(span, window - span)
        x = torch.maximum(x[:, :-step], x[:, step:])
        x = torch.maximum(x[..., :-step], x[..., step:])
        span += step
    return x


def _square_max(x: Tensor, side: int) -> Tensor:
    """Maximum over squares of numbers (B, H, W) that are not negative; at least two squares each way, some outside.

    torch.export takes a size that may be 1 for one that is broadcast, and then for one that is always larger.
    """
    return F.max_pool2d(F.pad(x, (0, 2 * side - 1, 0, 2 * side - 1))[:, None], side)[:, 0]

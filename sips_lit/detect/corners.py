"""How much of a corner there is around each pixel: a second opinion on points, which knows nothing of any training data.

A network ranks textures that its training never showed as it happens to; where an image changes in both directions, points
are found again anywhere (Shi and Tomasi 1994), and descriptors tell them from others. Where both agree, points are better
than by either alone on kinds of data that training left out (our choice).
"""

from __future__ import annotations

from typing import Final

import torch
import torch.nn.functional as F
from torch import Tensor

from sips_lit.detect.octaves import half_size

FINE_CELL: Final = 2
"""Side of the squares of pixels, in pixels, of which 3 x 3 make the window that says where a corner is."""

CELL: Final = 2 * FINE_CELL
"""The same for the window that says how much of a corner there is."""

USUAL: Final = 5.0
"""Subtracted: about what the best points of a photograph have, so that it changes their order, and scores little."""


def corner_strength(image: Tensor, coarse: float = 1.0, fine: float = 0.0) -> Tensor:
    """Strength (B, 1, H, W) float32 of grey images (B, 1, H, W), 0 to 255: log(1 + the smaller eigenvalue) - `USUAL`.

    The eigenvalue, in squared grey values a pixel, is that of the structure tensor over 3 x 3 cells, linear between their
    centres; without any texture it is 0, and noise of a grey value hardly more. It is the sum of ``coarse`` times that over
    cells of `CELL` x `CELL` pixels, and ``fine`` times that over cells of `FINE_CELL`; what weighs 0 is not computed.
    """
    height, width = image.shape[-2:]
    # eigenvalues are small differences of large numbers: nothing here is rounded under autocast
    # on by more than a cell: the last one is whole, and no side is of one cell, which torch.export would take for a constant
    image = F.pad(image.float(), (1, 2 * CELL, 1, 2 * CELL), mode="replicate")
    dx = (image[..., 1:-1, 2:] - image[..., 1:-1, :-2]) / 2
    dy = (image[..., 2:, 1:-1] - image[..., :-2, 1:-1]) / 2
    cells = torch.cat([half_size(product) for product in (dx * dx, dy * dy, dx * dy)], 1)
    total = torch.zeros((), device=image.device)
    if fine:
        total = fine * _between_cells(cells, FINE_CELL, height, width)
    return total + coarse * _between_cells(half_size(cells), CELL, height, width) if coarse else total


def _between_cells(cells: Tensor, cell: int, height: int, width: int) -> Tensor:
    """Strength (B, 1, H, W) of the means (B, 3, h, w) of dx dx, dy dy and dx dy of each cell."""
    cells = F.pad(cells, (1, 1, 1, 1), mode="replicate")
    # sums of slices take a tenth of the time of torch's pooling on a CPU
    rows = cells[..., :-2, :] + cells[..., 1:-1, :] + cells[..., 2:, :]
    xx, yy, xy = ((rows[..., :-2] + rows[..., 1:-1] + rows[..., 2:]) / 9).chunk(3, 1)
    half = (xx - yy) / 2
    smaller = (xx + yy) / 2 - torch.sqrt(half * half + xy * xy)
    strength = torch.log1p(F.relu(smaller)) - USUAL  # rounding makes it negative
    between = F.interpolate(strength, scale_factor=float(cell), mode="bilinear", align_corners=False)
    return between[..., :height, :width]

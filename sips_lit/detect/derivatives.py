"""What corner detectors compute from an image, as channels for a score network."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

CHANNELS = 7

_GAIN = 4.0  # edges of 16 grey values a pixel have a derivative of 1: our choice

# first derivatives by Sobel, then second ones: x, y, xx, yy, xy
_FILTERS = (
    [[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]],
    [[-1, -2, -1], [0, 0, 0], [1, 2, 1]],
    [[0, 0, 0], [1, -2, 1], [0, 0, 0]],
    [[0, 1, 0], [0, -2, 0], [0, 1, 0]],
    [[1, 0, -1], [0, 0, 0], [-1, 0, 1]],
)
_NORM = (8.0, 8.0, 1.0, 1.0, 4.0)


def derivative_filters() -> Tensor:
    """The five filters (5, 1, 3, 3) of `derivative_channels`."""
    filters = torch.tensor(_FILTERS, dtype=torch.float32) / torch.tensor(_NORM)[:, None, None]
    return _GAIN * filters[:, None]


def derivative_channels(image: Tensor, filters: Tensor) -> Tensor:
    """Channels (B, 7, H - 2, W - 2) of scaled images (B, 1, H, W): grey, its gradient and products of derivatives.

    The products are those of the structure tensor (Ix Ix, Iy Iy, Ix Iy) and the determinant of the Hessian, compressed by
    a logarithm that keeps their sign. Convolutions can learn derivatives, but products only roughly. The idea to mix them
    with learned filters is that of Key.Net (Barroso-Laguna et al., ICCV 2019); which ones, and the logarithm, are ours.
    """
    derivatives = F.conv2d(image, filters)
    return mixed_channels(image[..., 1:-1, 1:-1], *derivatives.chunk(5, 1))


def mixed_channels(grey: Tensor, dx: Tensor, dy: Tensor, dxx: Tensor, dyy: Tensor, dxy: Tensor) -> Tensor:
    """The channels of `derivative_channels` (B, 7 C, H, W) of grey and its derivatives, each (B, C, H, W)."""
    products = torch.cat([dx * dx, dy * dy, dx * dy, dxx * dyy - dxy * dxy], 1)
    return torch.cat([grey, dx, dy, products.sign() * products.abs().log1p()], 1)

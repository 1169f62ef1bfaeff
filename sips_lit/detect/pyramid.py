"""Multi-scale detection: an image pyramid, and suppression across its levels (paper, multi-scale section)."""

from __future__ import annotations

import numpy as np
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor


def image_pyramid(image: Tensor, scales: int, factor: float) -> list[Tensor]:
    """``scales`` images (1, 1, H / factor^s, W / factor^s) of one image (1, 1, H, W), the first unchanged.

    Each level is shrunk from the original with an anti-aliasing filter. Levels that would be smaller than one pixel are
    left out.
    """
    height, width = image.shape[-2:]
    sizes = [(round(height / factor**s), round(width / factor**s)) for s in range(1, scales)]
    return [image] + [
        F.interpolate(image, size, mode="bilinear", align_corners=False, antialias=True)
        for size in sizes
        if min(size) > 0
    ]


def to_full_resolution(xy: Tensor, level_size: tuple[int, int], size: tuple[int, int]) -> Tensor:
    """Points (N, 2) of a pyramid level in pixels of the original; sizes are (H, W). Pixel centres are integers."""
    scale = xy.new_tensor([size[1] / level_size[1], size[0] / level_size[0]])
    return (xy + 0.5) * scale - 0.5


def suppress_across_levels(
    xy: NDArray[np.float32], level: NDArray[np.int64], radius: float, n: int
) -> NDArray[np.int64]:
    """Indices of at most ``n`` points to keep, of points (N, 2) that are sorted best first.

    Greedy: a point is dropped if a better, kept one of *another* level lies within Chebyshev distance ``radius`` in pixels
    of the original (within a level the local maxima already keep their distance).
    """
    kept = np.empty(min(n, len(xy)), np.int64)
    count = 0
    for index in range(len(xy)):
        if count == len(kept):
            break
        rivals = kept[:count][level[kept[:count]] != level[index]]
        if not len(rivals) or np.abs(xy[rivals] - xy[index]).max(1).min() > radius:
            kept[count] = index
            count += 1
    return kept[:count]

"""Logits of a pixel as their mean over octaves: the image, half of it, a quarter, and so on.

What stays a good point when the image is halved is there for other reasons than the texture of single pixels, and is
found again from further away. The same network scores every octave, so it has no more weights for it, and it learns from
one octave alone: two opinions are worth more where neither was made with the other in mind (our choice).
"""

from __future__ import annotations

from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor


def mean_over_octaves(logits_of: Callable[[Tensor], Tensor], image: Tensor, octaves: int, first: int = 0) -> Tensor:
    """Logits (B, 1, H, W) of images (B, 1, H, W): the mean of those that ``logits_of`` gives each octave.

    ``first`` is the largest octave that counts, 0 the image itself.
    """
    levels = [image, *halves(image, first + octaves)]
    size = image.shape[-2], image.shape[-1]
    total = enlarged(logits_of(levels[first]), first, size)
    for octave in range(first + 1, first + octaves):
        total = total + enlarged(logits_of(levels[octave]), octave, size)
    return total / octaves if octaves > 1 else total


def halves(image: Tensor, octaves: int) -> list[Tensor]:
    """The octaves of images (B, 1, H, W) after the first, each half the one before: the mean of 2 x 2 pixels.

    The image goes on with its last pixels, so an octave ends one or two pixels later than the one before, and never has a
    side of one pixel, which `torch.export` would take for a constant.
    """
    levels = []
    for _ in range(1, octaves):
        image = half_size(F.pad(image, (0, 3, 0, 3), mode="replicate"))
        levels.append(image)
    return levels


def half_size(values: Tensor) -> Tensor:
    """The means (B, C, H // 2, W // 2) of 2 x 2 neighbours of ``values`` (B, C, H, W), by sums in the order of pooling.

    Sums of slices take a fifth of the time of torch's pooling on a CPU; of an odd size `torch.export` can't tell that they
    fit each other.
    """
    if torch.compiler.is_exporting():
        return F.avg_pool2d(values, 2)
    height, width = values.shape[-2] // 2 * 2, values.shape[-1] // 2 * 2
    upper, lower = values[..., 0:height:2, :width], values[..., 1:height:2, :width]
    return (upper[..., 0::2] + upper[..., 1::2] + lower[..., 0::2] + lower[..., 1::2]) / 4


def enlarged(logits: Tensor, octave: int, size: tuple[int, int]) -> Tensor:
    """Logits (B, 1, h, w) of an octave (0 = the image) between its pixels, for an image of ``size`` (H, W)."""
    if octave == 0:
        return logits
    large = F.interpolate(logits, scale_factor=2.0**octave, mode="bilinear", align_corners=False)
    return large[..., : size[0], : size[1]]

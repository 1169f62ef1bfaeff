"""Logits of a pixel as their mean over octaves: the image, half of it, a quarter, and so on.

What stays a good point when the image is halved is there for other reasons than the texture of single pixels, and is
found again from further away. The same network scores every octave, so it has no more weights for it, and it learns from
one octave alone: two opinions are worth more where neither was made with the other in mind (our choice).

Between two octaves lies one of two thirds of the larger one's size, as in BRISK (Leutenegger, Chli, Siegwart 2011): octave
0.5 is two thirds of the image, 1.5 a third.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import torch
import torch.nn.functional as F
from torch import Tensor

OCTAVE_STEPS: Final = (1, 0.5)
"""From an octave to the next that is scored: halves of the image, or also those between."""


def mean_over_octaves(
    logits_of: Callable[[Tensor], Tensor], image: Tensor, octaves: int, first: float = 0, step: float = 1
) -> Tensor:
    """Logits (B, 1, H, W) of images (B, 1, H, W): the mean of those that ``logits_of`` gives each of ``octaves``.

    ``first`` is the largest octave that counts, 0 the image itself, ``step`` what is added to it for each next one; both are
    multiples of a half.
    """
    counted = [first + step * index for index in range(octaves)]
    levels = [image, *halves(image, int(counted[-1]) + 1)]
    size = image.shape[-2], image.shape[-1]
    parts = []
    for octave in counted:
        level = levels[int(octave)]
        parts.append(enlarged(logits_of(level if octave == int(octave) else two_thirds(level)), octave, size))
    total = sum(parts[1:], parts[0])
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


def two_thirds(image: Tensor) -> Tensor:
    """Images (B, 1, h, w) of two thirds of the size of ``image`` (B, 1, H, W), which goes on with its last pixels.

    Linear between the pixels: 3 x 3 of them become 2 x 2, all with the same weights, mirrored. h and w are even.
    """
    image = F.pad(image, (0, 5, 0, 5), mode="replicate")
    return _blocks(image, [[3 / 4, 1 / 4, 0], [0, 1 / 4, 3 / 4]], stride=3)


def enlarged(logits: Tensor, octave: float, size: tuple[int, int]) -> Tensor:
    """Logits (B, 1, h, w) of an octave (0 = the image) between its pixels, for an image of ``size`` (H, W)."""
    if octave != int(octave):
        # 2 x 2 become 3 x 3, in fractions: a factor of 1.5 is rounded otherwise by each runtime
        between = [[1 / 6, 5 / 6, 0, 0], [0, 1 / 2, 1 / 2, 0], [0, 0, 5 / 6, 1 / 6]]
        logits = _blocks(F.pad(logits, (1, 1, 1, 1), mode="replicate"), between, stride=2)
    if octave >= 1:
        logits = F.interpolate(logits, scale_factor=2.0 ** int(octave), mode="bilinear", align_corners=False)
    return logits if octave == 0 else logits[..., : size[0], : size[1]]


def _blocks(values: Tensor, weights: list[list[float]], stride: int) -> Tensor:
    """Values (B, 1, S m, S n) of (B, 1, H, W): S x S for each step of ``stride``, by S rows of ``weights`` a side."""
    sides = torch.tensor(weights, device=values.device)
    filters = torch.einsum("yi,xj->yxij", sides, sides).flatten(0, 1).unsqueeze(1)
    with torch.autocast(values.device.type, enabled=False):  # rounded grey values are noise
        return F.pixel_shuffle(F.conv2d(values.float(), filters, stride=stride), len(weights))

"""The logits that points are detected by: what a network learned to give, and what is added to it without learning."""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor

from sips_lit.detect.corners import corner_strength
from sips_lit.detect.octaves import mean_over_octaves


def detection_logits(logits_of: Callable[[Tensor], Tensor], image: Tensor, octaves: int, corners: float) -> Tensor:
    """Logits (B, 1, H, W) of images (B, 1, H, W): the mean over octaves, and ``corners`` times the strength as a corner."""
    logits = mean_over_octaves(logits_of, image, octaves)
    return logits + corners * corner_strength(image) if corners else logits

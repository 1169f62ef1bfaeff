"""A score network on strips of an image, one after the other: the same logits from buffers that are used again.

A layer of a whole 640 x 480 image gives 10 MB and more. Memory of that size comes from the system anew for each layer, page
by page, which takes longer than the layers of ``tiny``; with strips it stays the process's own, and near the processor.
Each strip sees ``radius`` rows more to both sides, so nothing is lost but the layers' values of these rows, computed twice
(our choice).
"""

from __future__ import annotations

import math
from functools import partial
from typing import Final

from torch import Tensor

from sips_lit.detect.detection_logits import detection_logits
from sips_lit.detect.folding import block_side, folded_valid, whole_blocks
from sips_lit.detect.score_network import ScoreNetwork

STRIP_BYTES: Final = 1_000_000
"""Of the widest layer of a strip in float32, about: with less, more rows are computed twice."""
RADII: Final = 8
"""Rows of a strip at least, in radii of the network, whatever they take: a quarter more are seen."""


def logits_by_strips(network: ScoreNetwork, image: Tensor) -> Tensor:
    """Logits (B, 1, H, W) float32 of grey images (B, 1, H, W), 0 to 255: the network's, but for the last digits."""
    return detection_logits(partial(_octave, network), image, network.detection)


def strip_rows(network: ScoreNetwork, height: int, width: int) -> int:
    """Rows of each strip but the last of an image (H, W): whole blocks, and strips of about the same size."""
    channels: int = network.config["width"]
    most, side = max(STRIP_BYTES // (4 * channels * width), RADII * network.radius), block_side(network)
    return side * math.ceil(height / math.ceil(height / most) / side)


def _octave(network: ScoreNetwork, image: Tensor) -> Tensor:
    """See `ScoreNetwork.octave`."""
    height, width = image.shape[-2:]
    padded = network.pad(whole_blocks(image, block_side(network)))
    valid, margin = folded_valid(network), 2 * network.radius
    logits = image.new_empty((image.shape[0], 1, *(size - margin for size in padded.shape[-2:])))
    rows = strip_rows(network, height, width * image.shape[0])
    for top in range(0, logits.shape[-2], rows):
        strip = padded[..., top : top + rows + margin, :]
        logits[..., top : top + rows, :] = valid(strip)
    return logits[..., :height, :width].contiguous()

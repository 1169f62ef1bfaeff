"""A narrow score network on blocks of pixels: the same function, with the vector units of a CPU filled.

A CPU's convolutions compute 16 output channels at a time, and networks with 4 or 8 leave most of that idle. On an image
whose 2 x 2 blocks of pixels are channels, a valid 3 x 3 layer of C to O channels is a valid 2 x 2 layer of 4 C to 4 O: a
block of four outputs sees 4 x 4 pixels, which are 2 x 2 blocks. Seven of sixteen weights are zero, and still the layers
of ``tiny`` take 29 ms instead of 43 (one thread, 640 x 480). Our choice.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, cast

import torch
import torch.nn.functional as F
from torch import Tensor

from sips_lit.detect.derivatives import mixed_channels
from sips_lit.detect.score_network import ScoreNetwork

WIDEST: Final = 8
"""Channels up to which blocks are faster: at 16 a layer fills the vectors without them."""


def block_side(network: ScoreNetwork) -> int:
    """The side of the blocks, in pixels, on which the network is fastest on a CPU: 2, or 1 for wide ones."""
    return 2 if network.config["width"] <= WIDEST else 1


def folded_weight(weight: Tensor, side: int) -> Tensor:
    """Weights (side^2 O, side^2 C, K, K) of a layer on blocks that does what 3 x 3 ``weight`` (O, C, 3, 3) does on pixels.

    Channel c of a pixel at (y, x) of its block is channel side^2 c + side y + x, as `torch.nn.functional.pixel_unshuffle`
    has it. K = 2 for blocks of 2 x 2 pixels, 3 for pixels.
    """
    outputs, inputs = weight.shape[:2]
    kernel = math.ceil((side + 2) / side)
    taps = _placed(weight, side).view(outputs, side**2, inputs, kernel, side, kernel, side)
    return taps.permute(0, 1, 2, 4, 6, 3, 5).reshape(outputs * side**2, inputs * side**2, kernel, kernel)


def folded_filters(filters: Tensor, side: int) -> Tensor:
    """Filters (side^2 (1 + F), 1, K, K) for a grey image, with stride ``side``: grey itself, then F filters (F, 1, 3, 3)."""
    identity = torch.zeros_like(filters[:1])
    identity[..., 1, 1] = 1
    return _placed(torch.cat([identity, filters]), side).flatten(0, 1)


def _placed(weight: Tensor, side: int) -> Tensor:
    """(O, side^2, C, S, S): the weights of each pixel of an output block, placed among the pixels that the block sees."""
    free = math.ceil((side + 2) / side) * side - 3
    return torch.stack([F.pad(weight, (x, free - x, y, free - y)) for y in range(side) for x in range(side)], 1)


def whole_blocks(image: Tensor, side: int) -> Tensor:
    """The image with its last row and column repeated until it is whole blocks, as the network repeats them anyway."""
    return F.pad(image, (0, -image.shape[-1] % side, 0, -image.shape[-2] % side), mode="replicate")


def folded_valid(network: ScoreNetwork) -> Callable[[Tensor], Tensor]:
    """What `ScoreNetwork.valid` does, but for the last digits, on blocks where these are faster on a CPU.

    Of padded, scaled images (B, 1, H + 2 radius, W + 2 radius) whose H and W are whole blocks; a row or column more, less
    than a block, changes nothing. The weights are those that the network has now.
    """
    side = block_side(network)
    if side == 1:
        return network.valid
    first = _first_channels(network, side)
    weights = [folded_weight(cast(Tensor, layer.weight), side) for layer in network.layers]
    weights = [weight.contiguous(memory_format=torch.channels_last) for weight in weights]
    biases = [cast(Tensor, layer.bias).repeat_interleave(side**2) for layer in network.layers]

    def valid(padded: Tensor) -> Tensor:
        x = first(padded)
        for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
            x = F.leaky_relu(F.conv2d(x, weight, bias), network.leaky_slope, inplace=not torch.is_grad_enabled())
        with torch.autocast(x.device.type, enabled=False):  # equal logits would make the order of the points arbitrary
            return F.pixel_shuffle(F.conv2d(x.float(), weights[-1], biases[-1]), side)

    return valid


def _first_channels(network: ScoreNetwork, side: int) -> Callable[[Tensor], Tensor]:
    """From a padded image to what the first layer sees, on blocks."""
    if not network.derivatives:
        pixels = torch.eye(side**2).view(side**2, 1, side, side)  # each of a block, as pixel_unshuffle, of any size
        return lambda padded: F.conv2d(padded, pixels, stride=side).contiguous(memory_format=torch.channels_last)
    filters = folded_filters(cast(Tensor, network.filters), side)

    def channels(padded: Tensor) -> Tensor:
        with torch.autocast(padded.device.type, enabled=False):  # differences of rounded grey values are noise
            mixed = mixed_channels(*F.conv2d(padded.float(), filters, stride=side).chunk(6, 1))
        return mixed.contiguous(memory_format=torch.channels_last)

    return channels

"""Random weights of networks that see in a turned image what they see in the image, turned: where points lie is exact."""

from pathlib import Path

import torch
from random_weights import weights_file
from torch import Tensor

CELL = 64  # pixels of SuperPoint's cell


def turning_weights(name: str, folder: Path) -> str:
    """As `weights_file`, turned by 180 degrees and averaged with themselves: every kernel, in SuperPoint all channels, too.

    Deformable convolutions (ALIKED) are not deformed: their offsets would have to change their sign.
    """
    path = weights_file(name, folder)
    held = torch.load(path, weights_only=True)
    turn = _reverse if name == "superpoint" else _flip
    weights = {key: (value + turn(value)) / 2 if value.is_floating_point() else value for key, value in held.items()}
    torch.save({key: value * ("offset_conv" not in key) for key, value in weights.items()}, path)
    return str(path)


def _flip(weight: Tensor) -> Tensor:
    return weight.flip(-1, -2) if weight.ndim == 4 else weight


def _reverse(weight: Tensor) -> Tensor:
    """As `_flip`, with channels in reverse order: pixel c of a cell is pixel 63 - c of the turned one. No point stays so."""
    points = CELL if len(weight) == CELL + 1 else len(weight)
    weight = torch.cat([weight[:points].flip(0), weight[points:]])
    return _flip(weight.flip(1) if weight.ndim == 4 else weight)

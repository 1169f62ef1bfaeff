"""The network of SuperPoint (DeTone et al. 2018, section 3), with the weights of either published file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

import torch.nn.functional as F
from torch import Tensor, nn

CELL: Final = 8  # pixels: three poolings by 2
_WIDTHS: Final = {"1": 64, "2": 64, "3": 128, "4": 128}
_HEAD, _DESCRIPTOR = 256, 256
# names of the heads in the layout of rpautrat/SuperPoint
_HEADS: Final = {"detector.0": "Pa", "detector.1": "Pb", "descriptor.0": "Da", "descriptor.1": "Db"}


class SuperPointNetwork(nn.Module):
    """A VGG-style encoder of eight 3 x 3 convolutions, and two heads on its map of 8 x 8 pixel cells.

    ``batch_norm``: normalise after each activation (after the convolution, where a head ends without one), as
    rpautrat/SuperPoint does; the authors' network does not.
    """

    def __init__(self, batch_norm: bool) -> None:
        super().__init__()
        channels = 1
        for stage, width in _WIDTHS.items():
            self._add(f"{stage}a", channels, width, 3, batch_norm)
            self._add(f"{stage}b", width, width, 3, batch_norm)
            channels = width
        for head, out in (("P", CELL * CELL + 1), ("D", _DESCRIPTOR)):
            self._add(f"{head}a", channels, _HEAD, 3, batch_norm)
            self._add(f"{head}b", _HEAD, out, 1, batch_norm)

    def _add(self, name: str, inputs: int, outputs: int, kernel: int, batch_norm: bool) -> None:
        self.add_module(f"conv{name}", nn.Conv2d(inputs, outputs, kernel, padding=kernel // 2))
        self.add_module(f"bn{name}", nn.BatchNorm2d(outputs, eps=1e-3) if batch_norm else nn.Identity())

    def _layer(self, x: Tensor, name: str, activation: bool = True) -> Tensor:
        x = self.get_submodule(f"conv{name}")(x)
        out: Tensor = self.get_submodule(f"bn{name}")(F.relu(x) if activation else x)
        return out

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Logits (B, 65, H/8, W/8) and descriptors (B, 256, H/8, W/8) of length 1, of images (B, 1, H, W) in [0, 1]."""
        x = image
        for stage in _WIDTHS:
            x = F.max_pool2d(x, 2) if stage != "1" else x
            x = self._layer(self._layer(x, f"{stage}a"), f"{stage}b")
        logits = self._layer(self._layer(x, "Pa"), "Pb", activation=False)
        descriptors = self._layer(self._layer(x, "Da"), "Db", activation=False)
        return logits, F.normalize(descriptors, dim=1)


def is_rpautrat(weights: Mapping[str, Tensor]) -> bool:
    """Whether ``weights`` are in the layout of rpautrat/SuperPoint; else they should be MagicLeap's."""
    return any(key.startswith("backbone.") for key in weights)


def to_our_names(weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Weights of either layout by the names of `SuperPointNetwork`; unknown names stay as they are.

    MagicLeap's ``conv1a`` to ``convDb`` are ours; rpautrat's are ``backbone.<stage>.<0 or 1>.<conv or bn>`` and so on.
    """
    return {_our_name(key): value for key, value in weights.items()}


def _our_name(key: str) -> str:
    match = re.fullmatch(r"(backbone\.\d|detector|descriptor)\.(\d)\.(conv|bn)\.(\w+)", key)
    if match is None:
        return key
    part, index, kind, parameter = match.groups()
    if part.startswith("backbone"):
        layer = f"{int(part[-1]) + 1}{'ab'[int(index)]}" if index in "01" else key
    else:
        layer = _HEADS.get(f"{part}.{index}", key)
    return f"{kind}{layer}.{parameter}"

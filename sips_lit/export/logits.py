"""A network's logits in an exported graph: of narrow networks on blocks of pixels, with weights that are made beforehand."""

from __future__ import annotations

import torch.nn.functional as F
from torch import Tensor, nn

from sips_lit.detect.detection_logits import detection_logits
from sips_lit.detect.folding import block_side, folded_valid
from sips_lit.detect.score_network import ScoreNetwork


class LogitsOfImage(nn.Module):
    """Logits (B, 1, H, W) of images (B, 1, H, W), 0 to 255: the network's, but for the last digits.

    With the weights that it has when this is made.
    """

    def __init__(self, network: ScoreNetwork) -> None:
        super().__init__()
        self.network = network
        # by what an image goes on: more than a block, so that torch.export need not ask whether it is whole blocks
        self._more = 2 * block_side(network) - 1 if block_side(network) > 1 else 0
        self._valid = folded_valid(network)

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        return detection_logits(self._octave, image, self.network.detection)

    def _octave(self, image: Tensor) -> Tensor:
        height, width = image.shape[-2:]
        padded = self.network.pad(F.pad(image, (0, self._more, 0, self._more), mode="replicate"))
        return self._valid(padded)[..., :height, :width]

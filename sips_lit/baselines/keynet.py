"""Key.Net: handcrafted and learned filters on a pyramid (Barroso-Laguna et al. 2019), through kornia."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from sips_lit.baselines.learned import fill, network_image, read_weights
from sips_lit.detect.base import BaseDetector, best_keypoints
from sips_lit.errors import BadInputError, import_extra
from sips_lit.types import GreyImage, Keypoints

URL = "https://github.com/axelBarroso/Key.Net-Pytorch/raw/main/model/weights/keynet_pytorch.pth"
_CANDIDATES = 5000  # of each level, before all are ranked together
_BORDER = 15  # pixels of a level without points


class KeyNet(BaseDetector):
    """Key.Net with its own pyramid (one level up, four down, sqrt(2) apart) and suppression (15 x 15 on each level).

    The image keeps its size, in float32; there is no threshold on the score, and no point within 15 px (of the level) of
    the border. The scale of a point is that of its level, and at least 1.
    """

    name = "KeyNet"

    def __init__(self, weights: str | None = None) -> None:
        """``weights`` is the published file; without it, the one that kornia once downloaded.

        Raises BadInputError where kornia or the weights are missing.
        """
        kornia = import_extra("kornia.feature", "baselines", self.name)
        path = Path(weights) if weights else Path(torch.hub.get_dir()) / "checkpoints" / "keynet_pytorch.pth"
        if weights is None and not path.is_file():
            raise BadInputError(f"KeyNet's weights are in no package: download {URL} and give detector.weights=FILE")
        held = read_weights(path)
        self.network = kornia.KeyNetDetector(pretrained=False, num_features=_CANDIDATES).eval()
        fill(self.network.model, held.get("state_dict", held), path, self.name)

    @torch.inference_mode()
    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points, best first."""
        if min(image.shape) <= 2 * _BORDER:
            return Keypoints.empty()
        responses, frames = self.network.detect(network_image(image))
        found = responses[0] > 0  # the rest fills the array up
        frame = frames[0][found].numpy()
        scale = frame[:, 0, 0] / self.network.mr_size
        # kornia multiplies whole pixels of the level by its scale, as if levels shared the first pixel's centre; they
        # share its corner
        xy = frame[:, :, 2] + (scale[:, None] - 1) / 2
        return best_keypoints(xy, responses[0][found].numpy(), np.maximum(1, scale), n)[0]

"""The detector that users call: image in, best points with their probabilities out."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import torch
from torch import Tensor

from sips_lit.detect.base import BaseDetector
from sips_lit.detect.checkpoint import load_checkpoint
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector, image_tensor, score_map
from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey
from sips_lit.types import FloatArray, GreyImage, Keypoints, ScoreKind

# modes of PIL images whose bytes are indices of a palette, inks and the like
PIL_NEITHER_GREY_NOR_RGB: Final = frozenset({"P", "PA", "LA", "CMYK", "YCbCr", "HSV"})


class SipsDetector(BaseDetector):
    """Succinct interest points of an image.

    >>> detector = SipsDetector.from_checkpoint("outputs/.../checkpoints/best.ckpt")
    >>> points = detector("image.png", n=50)
    >>> points.xy.shape, points.score.shape
    ((50, 2), (50,))
    """

    name = "SIPs"
    scores: ScoreKind = "probability"

    def __init__(self, network: ScoreNetwork, selector: PointSelector, device: str | torch.device = "cpu") -> None:
        self.device = torch.device(device)
        self.network, self.selector = network.eval().to(self.device), selector

    @classmethod
    def from_checkpoint(
        cls, path: str | Path, device: str | torch.device = "cpu", subpixel: bool = True
    ) -> SipsDetector:
        """The detector of a ``.ckpt`` or ``.safetensors`` file; ``subpixel`` fits the peaks whatever training did.

        Raises BadInputError when the file is missing, damaged, or not of this architecture.
        """
        network, selector = load_checkpoint(path)
        return cls(network, PointSelector(selector.nms_radius, subpixel), device)

    def __call__(self, image: str | Path | np.ndarray[Any, Any] | Tensor | Any, n: int = 50) -> Keypoints:
        """The ``n`` points of ``image`` most likely to be inliers (fewer, if it has not so many), best first.

        ``image``: a path; a grey (H, W) or colour (H, W, 3) RGB array or PIL image, uint8 or float in [0, 1]; or a tensor,
        (H, W), (1, H, W) or (3, H, W). Raises BadInputError for anything else.
        """
        return self.detect(as_grey(image), n)

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points of a grey uint8 image (H, W), best first."""
        if n < 0:
            raise BadInputError(f"n is {n}: ask for a number of points that is not negative")
        return self.selector.select(self.network, image_tensor(image, self.device), n).keypoints

    def score_map(self, image: GreyImage) -> FloatArray:
        """Probability (H, W) float32 of being an inlier, of every pixel of a grey uint8 image, at full resolution."""
        return score_map(self.network, image)


def as_grey(image: Any) -> GreyImage:
    """Any of the image types that `SipsDetector` takes as grey uint8 (H, W). Raises BadInputError for others."""
    if isinstance(image, str | Path):
        return read_grey(Path(image))
    if isinstance(image, Tensor):
        values = image.detach().cpu()
        array = (values.float() if values.is_floating_point() else values).numpy()  # NumPy has no bfloat16
        array = np.moveaxis(array, 0, -1) if array.ndim == 3 else array
    else:
        if getattr(image, "mode", None) in PIL_NEITHER_GREY_NOR_RGB:
            image = image.convert("RGB")
        array = np.asarray(image)
    if array.ndim == 3 and array.shape[2] in (1, 3, 4):
        array = array[..., 0] if array.shape[2] == 1 else array[..., :3]
    elif array.ndim != 2:
        raise BadInputError(f"an image must be (H, W) or (H, W, 3), not of shape {array.shape}")
    if array.size == 0:
        raise BadInputError(f"the image is empty: its shape is {array.shape}")
    if np.issubdtype(array.dtype, np.floating):
        if not np.isfinite(array).all() or array.min() < 0 or array.max() > 1:
            raise BadInputError(
                "an image of floats must have finite values from 0 to 1: divide it by 255, or give uint8"
            )
        array = np.round(array * 255).astype(np.uint8)
    elif array.dtype == np.bool_:
        array = array.astype(np.uint8) * 255
    elif array.dtype == np.uint16:
        array = (array / 257 + 0.5).astype(np.uint8)
    elif array.dtype != np.uint8:
        raise BadInputError(f"an image must be uint8, uint16 or float in [0, 1], not {array.dtype}")
    if array.ndim == 3:
        array = cv2.cvtColor(np.ascontiguousarray(array), cv2.COLOR_RGB2GRAY)
    grey: GreyImage = np.require(array, np.uint8, ["C", "W"])  # PyTorch warns of arrays that are read-only
    return grey

"""The detector that users call: image in, best points with their probabilities out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor

from sips_lit.detect.base import BaseDetector
from sips_lit.detect.budget import Budget
from sips_lit.detect.checkpoint import load_checkpoint
from sips_lit.detect.recalibration import Recalibration
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector, image_tensor, score_map
from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey, to_grey
from sips_lit.types import FloatArray, GreyImage, Keypoints, ScoreKind

# modes of PIL images whose bytes are indices of a palette, inks and the like
PIL_NEITHER_GREY_NOR_RGB: Final = frozenset({"P", "PA", "LA", "La", "RGBa", "CMYK", "YCbCr", "HSV"})


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
        cls,
        path: str | Path,
        device: str | torch.device = "cpu",
        subpixel: bool = True,
        nms_radius: int | None = None,
        scales: int | None = None,
    ) -> SipsDetector:
        """The detector of a ``.ckpt`` or ``.safetensors`` file.

        ``subpixel`` fits the peaks whatever training did. ``nms_radius``: no two points within it, in pixels; ``scales``:
        levels of the image pyramid, for cameras that come nearer and turn, which a network trained on one level takes, too.
        None: those of the file. Raises BadInputError when the file is missing, damaged, or not of this architecture, and
        for numbers out of range.
        """
        network, selector = load_checkpoint(path)
        try:
            if scales is not None:
                network = network.with_scales(scales)
            radius = selector.nms_radius if nms_radius is None else nms_radius
            selector = replace(selector, nms_radius=radius, subpixel=subpixel)
        except ValueError as error:
            raise BadInputError(str(error)) from error
        return cls(network, selector, device)

    @property
    def recalibration(self) -> Recalibration:
        """What makes the network's logits the probabilities that points have as scores."""
        return self.selector.recalibration

    def __call__(self, image: str | Path | np.ndarray[Any, Any] | Tensor | Any, n: int = 50) -> Keypoints:
        """The ``n`` points of ``image`` most likely to be inliers (fewer, if it has not so many), best first.

        ``image``: a path; a grey (H, W) or colour (H, W, 3) RGB array or PIL image, uint8, uint16 or float in [0, 1]; or a
        tensor, (H, W), (1, H, W) or (3, H, W). Grey is that of `read_grey`. Raises BadInputError for anything else.
        """
        return self.detect(as_grey(image), n)

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points of a grey uint8 image (H, W), best first."""
        if n < 0:
            raise BadInputError(f"n is {n}: ask for a number of points that is not negative")
        return self.selector.select(self.network, image_tensor(image, self.device), n).keypoints

    def within(self, image: str | Path | np.ndarray[Any, Any] | Tensor | Any, budget: Budget) -> tuple[Keypoints, bool]:
        """The points of ``image`` that a ``budget`` keeps, and whether they are enough for its k inliers; see `Budget.keep`.

        ``image`` as in a call of the detector.
        """
        return budget.keep(self(image, budget.candidates), self.recalibration)

    def best(self, keypoints: Keypoints, n: int) -> Keypoints:
        """The first ``n`` of its points of an image, with the probabilities that they have when the others are not kept."""
        return self.recalibration.best(keypoints, n)

    def score_map(self, image: GreyImage) -> FloatArray:
        """Probability (H, W) float32 of being an inlier, of every pixel of a grey uint8 image, at full resolution.

        Recalibrated as if 50 points were kept.
        """
        return score_map(self.network, image, self.recalibration)


def as_grey(image: Any) -> GreyImage:
    """Any of the image types that `SipsDetector` takes as grey uint8 (H, W). Raises BadInputError for others."""
    if isinstance(image, str | Path):
        return read_grey(Path(image))
    if isinstance(image, Tensor):
        values = image.detach().cpu()
        array = (values.float() if values.is_floating_point() else values).numpy()  # NumPy has no bfloat16
        array = np.moveaxis(array, 0, -1) if array.ndim == 3 else array
    else:
        mode = getattr(image, "mode", None)  # of a PIL image
        if mode == "LAB":
            raise BadInputError("an image in LAB must be converted first, since Pillow cannot: give RGB or grey")
        if mode in PIL_NEITHER_GREY_NOR_RGB:
            image = image.convert("RGBA" if mode == "RGBa" else "RGB")
        array = np.asarray(image)
    return to_grey(array, "the image", rgb=True)

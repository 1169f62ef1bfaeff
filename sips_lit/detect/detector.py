"""The detector that users call: image in, best points with their probabilities out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Final, get_args, overload

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sips_lit.detect.base import BaseDetector
from sips_lit.detect.budget import Budget
from sips_lit.detect.checkpoint import load_checkpoint
from sips_lit.detect.covariance import with_covariance
from sips_lit.detect.recalibration import Recalibration
from sips_lit.detect.released import DEFAULT, SHA256
from sips_lit.detect.runtime import make_runtime
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector, image_tensor, score_map
from sips_lit.detect.steps import step
from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey, to_grey
from sips_lit.types import ColorOrder, FloatArray, GreyImage, Keypoints, ScoreKind

# modes of PIL images whose bytes are indices of a palette, inks and the like
PIL_NEITHER_GREY_NOR_RGB: Final = frozenset({"P", "PA", "LA", "La", "RGBa", "CMYK", "YCbCr", "HSV"})
LEAST_OF_255: Final = 16.0
"""Floats whose largest is at least this (and at most 255) are of 0 to 255: less would be a black image in that range."""


class SipsDetector(BaseDetector):
    """Succinct interest points of an image.

    >>> detector = SipsDetector.from_pretrained()
    >>> points = detector("image.png", n=50)
    >>> points.xy.shape, points.score.shape
    ((50, 2), (50,))
    >>> len(detector(["a.png", "b.png"], n=50))  # of each image
    2
    """

    name = "SIPs"
    scores: ScoreKind = "probability"

    def __init__(
        self,
        network: ScoreNetwork,
        selector: PointSelector,
        device: str | torch.device = "cpu",
        runtime: str = "torch",
        precision: str | int = "32",
    ) -> None:
        """``runtime`` and ``precision``: see `sips_lit.detect.runtime.make_runtime`, which says what is refused, too."""
        self.network, self.selector = network.eval().to(device), selector
        self.runtime = make_runtime(self.network, runtime, precision)

    @property
    def device(self) -> torch.device:
        """Where the network is."""
        return next(self.network.parameters()).device

    @classmethod
    def from_checkpoint(
        cls,
        path: str | Path,
        device: str | torch.device = "cpu",
        subpixel: bool = True,
        nms_radius: int | None = None,
        scales: int | None = None,
        runtime: str = "torch",
        precision: str | int = "32",
        border: int | None = None,
        octaves: int | None = None,
        corners: float | None = None,
        first_octave: float | None = None,
        octave_step: float | None = None,
        fine_corners: float | None = None,
        whole_below: int | None = None,
    ) -> SipsDetector:
        """The detector of a ``.ckpt`` or ``.safetensors`` file, or of released weights by name.

        ``subpixel`` fits the peaks whatever training did. ``nms_radius``: no two points within it, in pixels; ``border``: no
        points on so many pixels along the border (on small images a sixteenth of the shorter side); ``scales``:
        levels of the image pyramid, for cameras that come nearer and turn, which a network trained on one level takes, too;
        ``octaves``: how many are scored together, ``first_octave``: 0 from the image on, 1 from half of it on, which takes a
        quarter of the time, 0.5 from two thirds on; ``octave_step``: 1, or 0.5 for those between, too; ``corners``: weight
        of how much of a corner there is around a point (`sips_lit.detect.corners`), ``fine_corners``: of the same close
        around it, which says where a point of a smaller image is; 0: without;
        ``whole_below``: images of fewer pixels are scored from the image itself on, whatever ``first_octave`` is.
        None: those of the file. ``runtime``: what executes the network, torch, onnxruntime, openvino or auto (the fastest
        that is installed for each image size, so last digits may differ from run to run); ``precision``: 32 or bf16.

        Raises BadInputError when the file is missing, damaged, or not of this architecture, for numbers out of range, and
        for a runtime that is not installed.
        """
        network, selector = load_checkpoint(path)
        try:
            network = network.detecting_by(
                scales=scales,
                octaves=octaves,
                first_octave=first_octave,
                octave_step=octave_step,
                corners=corners,
                fine_corners=fine_corners,
                whole_below=whole_below,
            )
            radius = selector.nms_radius if nms_radius is None else nms_radius
            margin = selector.border if border is None else border
            selector = replace(selector, nms_radius=radius, subpixel=subpixel, border=margin)
        except ValueError as error:
            raise BadInputError(str(error)) from error
        return cls(network, selector, device, runtime, precision)

    @classmethod
    def from_pretrained(cls, name: str = DEFAULT, **options: Any) -> SipsDetector:
        """The detector of weights that come with the package; ``options``: those of `from_checkpoint`.

        Raises BadInputError for another name, and when the weights are not what was released.
        """
        if name not in SHA256:
            raise BadInputError(f"there are no released weights {name}: give one of {', '.join(SHA256)}")
        return cls.from_checkpoint(name, **options)

    @property
    def recalibration(self) -> Recalibration:
        """What makes the network's logits the probabilities that points have as scores."""
        return self.selector.recalibration

    @overload
    def __call__(
        self, image: list[Any] | tuple[Any, ...], n: int = 50, color: ColorOrder = "rgb"
    ) -> list[Keypoints]: ...

    @overload
    def __call__(self, image: Tensor, n: int = 50, color: ColorOrder = "rgb") -> Any: ...

    @overload
    def __call__(self, image: str | Path | NDArray[Any] | Any, n: int = 50, color: ColorOrder = "rgb") -> Keypoints: ...

    def __call__(self, image: Any, n: int = 50, color: ColorOrder = "rgb") -> Keypoints | list[Keypoints]:
        """The ``n`` points of ``image`` most likely to be inliers (fewer, if it has not so many), best first.

        ``image``: a path; a grey (H, W) or colour (H, W, 3) array or PIL image; or a tensor, (H, W), (1, H, W) or
        (3, H, W). Values are uint8, uint16, or float from 0 to 1 or from 0 to 255. Grey is that of `read_grey`. ``color`` is
        the order of the channels of arrays and tensors: "bgr" for what `cv2.imread` gives. Of a batch, which is a list of
        images or a tensor (B, 1, H, W) or (B, 3, H, W), a list of what each image gives alone. Raises BadInputError for
        anything else.
        """
        if not is_batch(image):
            return self.detect(as_grey(image, color=color), n)
        # one after the other: on a CPU it is as fast, memory stays that of an image, and sums come out the same
        return [self.detect(as_grey(one, f"image {index} of the batch", color), n) for index, one in enumerate(image)]

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points of a grey uint8 image (H, W), best first, with covariances where the network has the head."""
        if n < 0:
            raise BadInputError(f"n is {n}: ask for a number of points that is not negative")
        with step("network"):
            tensor = image_tensor(image, self.device)
        return with_covariance(self.network, tensor, self.selector.select(self.runtime, tensor, n))

    def within(
        self, image: str | Path | NDArray[Any] | Tensor | Any, budget: Budget, color: ColorOrder = "rgb"
    ) -> tuple[Keypoints, bool]:
        """The points of ``image`` that a ``budget`` keeps, and whether they are enough for its k inliers; see `Budget.keep`.

        ``image``: one image, and ``color``, as in a call of the detector.
        """
        return budget.keep(self.detect(as_grey(image, color=color), budget.candidates), self.recalibration)

    def best(self, keypoints: Keypoints, n: int) -> Keypoints:
        """The first ``n`` of its points of an image, with the probabilities that they have when the others are not kept."""
        return self.recalibration.best(keypoints, n)

    def score_map(self, image: GreyImage) -> FloatArray:
        """Probability (H, W) float32 of being an inlier, of every pixel of a grey uint8 image, at full resolution.

        Recalibrated as if 50 points were kept.
        """
        return score_map(self.runtime, image, self.recalibration, self.device)


def is_batch(image: Any) -> bool:
    """Whether it is several images: a list or tuple, or a tensor of four dimensions."""
    return isinstance(image, list | tuple) or (isinstance(image, Tensor) and image.ndim == 4)


def as_grey(image: Any, name: str = "the image", color: ColorOrder = "rgb") -> GreyImage:
    """Any of the images that `SipsDetector` takes as grey uint8 (H, W); errors call it ``name``.

    ``color`` is the order of the channels of arrays and tensors; files and PIL images tell their own. Raises BadInputError
    for other images, and other orders.
    """
    if color not in get_args(ColorOrder):
        raise BadInputError(f"color is {color}: give {' or '.join(get_args(ColorOrder))}, the order of the channels")
    if isinstance(image, str | Path):
        return read_grey(Path(image))
    if isinstance(image, Tensor):
        values = image.detach().cpu()
        array = (values.float() if values.is_floating_point() else values).numpy()  # NumPy has no bfloat16
        array = np.moveaxis(array, 0, -1) if array.ndim == 3 else array
    else:
        mode = getattr(image, "mode", None)  # of a PIL image
        if mode == "LAB":
            raise BadInputError(f"{name} in LAB must be converted first, since Pillow cannot: give RGB or grey")
        color = color if mode is None else "rgb"
        if mode in PIL_NEITHER_GREY_NOR_RGB:
            image = image.convert("RGBA" if mode == "RGBa" else "RGB")
        array = np.asarray(image)
    if array.dtype.kind == "f" and array.size and array.min() >= 0 and LEAST_OF_255 <= array.max() <= 255:
        array = array / np.float32(255)
    return to_grey(array, name, rgb=color == "rgb")

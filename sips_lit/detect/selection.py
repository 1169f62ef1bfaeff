"""Which points of an image the network selects: the step that training and inference share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from sips_lit.detect.peaks import local_maxima, quadratic_offsets
from sips_lit.detect.recalibration import AS_TRAINED, Recalibration
from sips_lit.detect.score_network import Gradient, Places, ScoreNetwork
from sips_lit.detect.shared_effect import sigmoid
from sips_lit.detect.steps import step
from sips_lit.errors import BadInputError
from sips_lit.types import FloatArray, GreyImage, Keypoints

LARGEST_RADIUS = 1000  # pixels; a damaged checkpoint may ask for any
SIXTEENTH = 16
"""Of the shorter side of an image, at most, have no points along its border."""


Numbers = TypeVar("Numbers", NDArray[Any], Tensor)
"""Arrays or tensors."""


class Scorer(Protocol):
    """A score network, or what runs one (see `sips_lit.detect.runtime`)."""

    @property
    def scales(self) -> int:
        """Levels of the pyramid."""

    @property
    def scale_factor(self) -> float:
        """Between two levels of the pyramid."""

    def __call__(self, image: Tensor, /) -> Tensor:
        """Logits (B, 1, H, W) float32 of grey images (B, 1, H, W) with values 0 to 255."""


@dataclass(frozen=True, slots=True)
class OneOctave:
    """A score network that scores the image alone, whatever octaves it has: what it learns from."""

    network: ScoreNetwork

    @property
    def scales(self) -> int:
        """See `Scorer`."""
        return self.network.scales

    @property
    def scale_factor(self) -> float:
        """See `Scorer`."""
        return self.network.scale_factor

    def __call__(self, image: Tensor, /) -> Tensor:
        """See `Scorer`."""
        return self.network.octave(image)


@dataclass(frozen=True, slots=True)
class SelectedPoints:
    """N points and where in the network's pyramid they come from, best first.

    ``keypoints`` as everywhere; ``level``, ``row``, ``column`` (N,) int64 name the logit that each point stands for.
    """

    keypoints: Keypoints
    level: NDArray[np.int64]
    row: NDArray[np.int64]
    column: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.keypoints)


@dataclass(frozen=True, slots=True)
class PointSelector:
    """Selects the n best local maxima of a score network.

    ``nms_radius``: no two points closer than or equal to it (pixels, Chebyshev); ``subpixel``: quadratic fit of the peaks;
    ``border``: no points on so many rows and columns along the border of the image, which leave the view first and whose
    descriptors lack a part of theirs, nor on more than a sixteenth of its shorter side (our choice); ``recalibration``:
    what makes the logits the probabilities that points have as scores.
    """

    nms_radius: int = 5
    subpixel: bool = True
    border: int = 0
    recalibration: Recalibration = AS_TRAINED

    def __post_init__(self) -> None:
        if self.nms_radius not in range(LARGEST_RADIUS + 1):
            raise ValueError(f"nms_radius is {self.nms_radius}: it counts pixels, from 0 to {LARGEST_RADIUS}")
        if self.border not in range(LARGEST_RADIUS + 1):
            raise ValueError(f"border is {self.border}: it counts pixels, from 0 to {LARGEST_RADIUS}")

    @property
    def config(self) -> dict[str, Any]:
        """How points are chosen: the constructor's arguments but for the recalibration."""
        return {"nms_radius": self.nms_radius, "subpixel": self.subpixel, "border": self.border}

    @property
    def anywhere(self) -> PointSelector:
        """The same with points up to the border."""
        return replace(self, border=0)

    def select(self, network: Scorer, image: Tensor, n: int) -> SelectedPoints:
        """At most ``n`` points of one image (1, 1, H, W) with values 0 to 255, on the network's device.

        Raises BadInputError when the network's scores are not finite.
        """
        return self.select_each(network, image, n)[0]

    @torch.no_grad()
    def select_each(self, network: Scorer, images: Tensor, n: int) -> list[SelectedPoints]:
        """As `select`, of B images (B, 1, H, W) that the network sees together: the same but for its rounding."""
        levels = []
        for level in image_pyramid(images, network.scales, network.scale_factor):
            with step("network"):
                levels.append(network(level)[:, 0])
        size = (images.shape[-2], images.shape[-1])
        return [
            self._of_image([logits[i] for logits in levels], size, n, network.scale_factor) for i in range(len(images))
        ]

    def _of_image(self, levels: Sequence[Tensor], size: tuple[int, int], n: int, factor: float) -> SelectedPoints:
        keep = n if len(levels) == 1 else None  # several levels lose points to suppression later, so none is cut here
        parts = [self._level(logits, index, size, keep) for index, logits in enumerate(levels)]
        xy, logit, where = (np.concatenate(column) for column in zip(*parts, strict=True))
        kept = np.arange(min(n, len(xy)))
        if len(levels) > 1:
            order = np.argsort(-logit, kind="stable")
            xy, logit, where = xy[order], logit[order], where[order]
            kept = suppress_across_levels(xy, where[:, 0], self.nms_radius, n)
        score = sigmoid(self.recalibration.logits(logit[kept], len(kept))).astype(np.float32)
        scale = factor ** where[kept, 0]
        keypoints = Keypoints(xy[kept], score, scale.astype(np.float32))
        return SelectedPoints(keypoints, where[kept, 0], where[kept, 1], where[kept, 2])

    def _level(
        self, logits: Tensor, index: int, size: tuple[int, int], keep: int | None
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
        """Points (N, 2) in full resolution, logits (N,) and places (N, 3) = (level, row, column) of one level, best first.

        In NumPy from the maxima on, which takes less time than PyTorch for so few numbers.
        """
        if not all_finite(logits):
            raise BadInputError(
                "the score network gives values that are not finite: its weights are broken (a damaged file or a diverged "
                "training); use another checkpoint, or train with a lower learning rate"
            )
        with step("suppression"):
            rows, columns = local_maxima(logits, self.nms_radius)
        inner = far_from_border(rows, columns, (logits.shape[0], logits.shape[1]), self.border)
        rows, columns = rows[inner][:keep], columns[inner][:keep]
        xy = np.stack([columns, rows], 1).astype(np.float32)
        if self.subpixel:
            with step("sub-pixel"):
                xy += quadratic_offsets(logits, rows, columns).astype(np.float32)
        if index > 0:
            xy = to_full_resolution(xy, (logits.shape[0], logits.shape[1]), size)
        values = logits.flatten()[torch.from_numpy(rows * logits.shape[1] + columns).to(logits.device)]
        return xy, values.float().cpu().numpy(), np.stack([np.full_like(rows, index), rows, columns], 1)


def all_finite(values: Tensor) -> bool:
    """Whether no value (...) is NaN or infinite."""
    if values.device.type == "cpu" and values.dtype == torch.float32:
        array = values.detach().numpy()
        return bool(np.isfinite(array.min(initial=0.0)) and np.isfinite(array.max(initial=0.0)))
    return bool(torch.isfinite(values).all())


def far_from_border(rows: Numbers, columns: Numbers, size: tuple[int, int], border: int) -> Numbers:
    """Which pixels (...,) of an image (H, W) have ``border`` pixels or a sixteenth of its shorter side outside, or more.

    Not by a minimum of both sides, which an exported graph does not know.
    """
    height, width = size

    def far(outside: Any) -> Any:
        further = SIXTEENTH * (outside + 1)
        return (outside >= border) | (further > height) | (further > width)

    inner: Numbers = far(rows) & far(height - 1 - rows) & far(columns) & far(width - 1 - columns)
    return inner


def image_pyramid(image: Tensor, scales: int, factor: float) -> list[Tensor]:
    """``scales`` images (B, 1, H / factor^s, W / factor^s) of images (B, 1, H, W), the first unchanged.

    Each level is shrunk from the original with an anti-aliasing filter, and rounded to 1/256 of a grey value: a blank image
    stays one, where rounding errors of the filter would be peaks. Levels that would be smaller than one pixel are left out.
    """
    height, width = image.shape[-2:]
    sizes = [(round(height / factor**s), round(width / factor**s)) for s in range(1, scales)]
    return [image] + [
        F.interpolate(image, size, mode="bilinear", align_corners=False, antialias=True).mul_(256).round_().div_(256)
        for size in sizes
        if min(size) > 0
    ]


def to_full_resolution(
    xy: NDArray[np.float32], level_size: tuple[int, int], size: tuple[int, int]
) -> NDArray[np.float32]:
    """Points (N, 2) of a pyramid level in pixels of the original; sizes are (H, W). Pixel centres are integers."""
    scale = np.array([size[1] / level_size[1], size[0] / level_size[0]], xy.dtype)
    return np.asarray((xy + 0.5) * scale - 0.5, xy.dtype)


def suppress_across_levels(
    xy: NDArray[np.float32], level: NDArray[np.int64], radius: float, n: int
) -> NDArray[np.int64]:
    """Indices of at most ``n`` points to keep, of points (N, 2) that are sorted best first.

    Greedy: a point is dropped if a better, kept one of *another* level lies within Chebyshev distance ``radius`` in pixels
    of the original (within a level the local maxima already keep their distance).
    """
    kept = np.empty(min(n, len(xy)), np.int64)
    count = 0
    for index in range(len(xy)):
        if count == len(kept):
            break
        rivals = kept[:count][level[kept[:count]] != level[index]]
        if not len(rivals) or np.abs(xy[rivals] - xy[index]).max(1).min() > radius:
            kept[count] = index
            count += 1
    return kept[:count]


def logits_at(
    network: ScoreNetwork, images: Sequence[Tensor], points: Sequence[SelectedPoints], gradient: Gradient
) -> list[Tensor]:
    """Logits (N,) of the selected points of each image (1, 1, H, W), differentiable, in the order of the points.

    The network sees all images at once (see `ScoreNetwork.at`).
    """
    levels: list[Tensor] = []
    places: list[Places] = []
    parts: list[tuple[int, Tensor]] = []  # image, and which of its points
    for index, (image, selected) in enumerate(zip(images, points, strict=True)):
        pyramid = image_pyramid(image, network.scales, network.scale_factor)
        for level in np.unique(selected.level):
            here = np.flatnonzero(selected.level == level)
            rows, columns, at = (
                torch.from_numpy(a).to(image.device) for a in (selected.row[here], selected.column[here], here)
            )
            levels.append(pyramid[level])
            places.append((rows, columns))
            parts.append((index, at))
    logits = [image.new_zeros(len(selected)) for image, selected in zip(images, points, strict=True)]
    if levels:
        for (index, at), of_part in zip(parts, network.at(levels, places, gradient), strict=True):
            logits[index][at] = of_part
    return logits


def image_tensor(image: GreyImage, device: torch.device | str = "cpu") -> Tensor:
    """Grey uint8 (H, W) as the network's input (1, 1, H, W) float32 with values 0 to 255."""
    return torch.from_numpy(np.ascontiguousarray(image)).to(device)[None, None].float()


@torch.no_grad()
def score_map(
    network: Scorer,
    image: GreyImage,
    recalibration: Recalibration = AS_TRAINED,
    device: torch.device | str = "cpu",
) -> FloatArray:
    """Probability (H, W) float32 of being an inlier, of every pixel of a grey uint8 image, at full resolution.

    Recalibrated as if `REFERENCE_POINTS` points were kept. ``device``: that of the network.
    """
    logits = network(image_tensor(image, device))
    scores: FloatArray = torch.sigmoid(recalibration.logits(logits))[0, 0].cpu().numpy()
    return scores

"""Points as kornia's local affine frames, and a detector as kornia's local features: kornia itself is not needed."""

from __future__ import annotations

from typing import Final

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from sips_lit.describe.sift import RootSift
from sips_lit.detect.base import best_keypoints
from sips_lit.detect.detector import SipsDetector, as_grey
from sips_lit.errors import BadInputError
from sips_lit.types import ColorOrder, Descriptor, Keypoints

RADIUS: Final = 24.0
"""Pixels at scale 1 from a point to the edge of the square that `RootSift` describes."""


def kornia_lafs(keypoints: Keypoints, radius: float = RADIUS) -> Tensor:
    """Local affine frames (1, N, 2, 3) float32 of N points: ``[[s, 0, x], [0, s, y]]`` with s = ``radius`` * scale.

    kornia counts pixels as we do: (0, 0) is the centre of the first.
    """
    size = radius * torch.from_numpy(keypoints.scale.copy())
    shape = size[:, None, None] * torch.eye(2)
    return torch.cat([shape, torch.from_numpy(keypoints.xy.copy())[:, :, None]], dim=2)[None]


class SipsFeature(nn.Module):
    """SIPs with a descriptor, called as a ``kornia.feature.LocalFeature`` is, and of use wherever one is.

    The frames are those of `kornia_lafs` with ``radius``. Nothing has a gradient: it is for inference.
    """

    def __init__(
        self,
        detector: SipsDetector,
        descriptor: Descriptor | None = None,
        n: int = 500,
        radius: float = RADIUS,
        color: ColorOrder = "rgb",
    ) -> None:
        """``descriptor`` is `RootSift` if none is given; ``n`` is the number of points of an image, at most.

        ``color`` is the order of the channels of its images: "bgr" for what `cv2.imread` gives.
        """
        super().__init__()
        self.network = detector.network  # so that .to(device) and state_dict() know it
        self.detector, self.descriptor = detector, descriptor or RootSift()
        self.n, self.radius, self.color = n, radius, color

    @torch.no_grad()
    def forward(self, image: Tensor, mask: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """Frames (B, N, 2, 3), responses (B, N) and descriptors (B, N, D) of images (B, 1 or 3, H, W), best first.

        Responses are probabilities of being an inlier, times the ``mask`` (B, 1, H, W) at the point; points where that is 0
        are left out. N is the largest number of points of an image; images with fewer end in rows of zeros, as kornia has
        it. Raises BadInputError for images as `SipsDetector` does, and for a mask of another size.
        """
        if image.ndim != 4:
            raise BadInputError(f"the image must be (B, 1, H, W) or (B, 3, H, W), not of shape {tuple(image.shape)}")
        size = (len(image), 1, *image.shape[-2:])
        if mask is not None and tuple(mask.shape) != size:
            raise BadInputError(f"the mask must be of shape {size} for these images, not {tuple(mask.shape)}")
        parts = [self._one(one, None if mask is None else mask[i, 0]) for i, one in enumerate(image)]
        most = max((len(responses) for _, responses, _ in parts), default=0)
        if not parts:
            parts = [self._of(Keypoints.empty(), np.zeros((1, 1), np.uint8))]
        lafs, responses, descriptors = (
            torch.stack([F.pad(rows, (0, 0) * (rows.ndim - 1) + (0, most - len(rows))) for rows in column])
            for column in zip(*parts, strict=True)
        )
        return tuple(rows[: len(image)].to(image.device) for rows in (lafs, responses, descriptors))  # type: ignore[return-value]

    def _one(self, image: Tensor, mask: Tensor | None) -> tuple[Tensor, Tensor, Tensor]:
        grey = as_grey(image, color=self.color)
        if mask is None:
            return self._of(self.detector.detect(grey, self.n), grey)
        every = self.detector.detect(grey, grey.size)
        column, row = np.rint(every.xy).astype(int).T
        weight = mask.detach().float().cpu().numpy()[row.clip(0, grey.shape[0] - 1), column.clip(0, grey.shape[1] - 1)]
        inside = weight > 0
        score = self.detector.recalibration.moved(every.score, len(every), min(self.n, int(inside.sum()))) * weight
        return self._of(best_keypoints(every.xy[inside], score[inside], every.scale[inside], self.n)[0], grey)

    def _of(
        self, keypoints: Keypoints, grey: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]
    ) -> tuple[Tensor, Tensor, Tensor]:
        descriptors = torch.from_numpy(self.descriptor.describe(grey, keypoints))
        return kornia_lafs(keypoints, self.radius)[0], torch.from_numpy(keypoints.score.copy()), descriptors

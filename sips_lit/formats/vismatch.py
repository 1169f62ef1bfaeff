"""A detector with mutual nearest neighbours, called as the matchers of vismatch are: vismatch itself is not needed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sips_lit.describe.sift import RootSift
from sips_lit.detect.detector import SipsDetector, as_grey
from sips_lit.frames.images import read_rgb
from sips_lit.geometry.two_view import fit_homography
from sips_lit.matching.confidence import shared_probability
from sips_lit.matching.mutual_nearest import distances, mutual_nearest
from sips_lit.types import Descriptor, Features


class SipsMatcher(nn.Module):
    """Matches two images by SIPs with a descriptor, and fits a homography to the matches, in the words of vismatch.

    ``ransac_reproj_thresh`` is in pixels; it, ``ransac_iters`` and ``ransac_conf`` are those of `cv2.findHomography`.
    """

    def __init__(
        self,
        detector: SipsDetector,
        descriptor: Descriptor | None = None,
        n: int = 500,
        ransac_iters: int = 2000,
        ransac_conf: float = 0.995,
        ransac_reproj_thresh: float = 3.0,
    ) -> None:
        """``descriptor`` is `RootSift` if none is given; ``n`` is the number of points of an image, at most."""
        super().__init__()
        self.network = detector.network  # so that .to(device) and state_dict() know it
        self.detector, self.descriptor, self.n = detector, descriptor or RootSift(), n
        self.ransac_iters, self.ransac_conf = ransac_iters, ransac_conf
        self.ransac_reproj_thresh = ransac_reproj_thresh

    @property
    def name(self) -> str:
        """What vismatch's tables call it."""
        return f"{self.detector.name} + {self.descriptor.name}"

    @staticmethod
    def load_image(path: str | Path) -> Tensor:
        """An image file as RGB (3, H, W) float32 from 0 to 1. Raises BadInputError when it can't be read."""
        return torch.from_numpy(read_rgb(path)).permute(2, 0, 1) / 255

    def forward(self, img0: Any, img1: Any) -> dict[str, Any]:
        """What vismatch gives of two images, each a tensor or array (3, H, W) from 0 to 1, RGB, a path or a PIL image.

        ``all_kpts0`` (N0, 2), ``all_desc0`` (N0, D), ``matched_kpts0`` (M, 2), ``inlier_kpts0`` (K, 2), the same of image 1;
        ``matched_confidences`` (M,), the geometric mean of the probabilities of both points; ``H`` (3, 3) from image 0 to
        image 1, None where there is none; ``num_inliers``. Raises BadInputError for images as `SipsDetector` does.
        """
        sides = self._features(img0), self._features(img1)
        matches = mutual_nearest(distances(*sides))
        kept = [side.keypoints[rows] for side, rows in zip(sides, (matches.index0, matches.index1), strict=True)]
        plane = fit_homography(kept[0].xy, kept[1].xy, self.ransac_reproj_thresh, self.ransac_iters, self.ransac_conf)
        result = {
            "num_inliers": int(plane.inlier.sum()),
            "H": plane.H,
            "matched_confidences": shared_probability(kept[0].score, kept[1].score),
        }
        for index, (side, matched) in enumerate(zip(sides, kept, strict=True)):
            result |= {
                f"all_kpts{index}": side.keypoints.xy,
                f"all_desc{index}": side.descriptors,
                f"matched_kpts{index}": matched.xy,
                f"inlier_kpts{index}": matched.xy[plane.inlier],
            }
        return result

    def extract(self, img: Any) -> dict[str, NDArray[Any]]:
        """``all_kpts0`` (N, 2) and ``all_desc0`` (N, D) of one image."""
        features = self._features(img)
        return {"all_kpts0": features.keypoints.xy, "all_desc0": features.descriptors}

    def _features(self, image: Any) -> Features:
        if isinstance(image, np.ndarray) and image.ndim == 3 and image.shape[0] in (1, 3):
            image = np.moveaxis(image, 0, -1)  # vismatch's arrays have the channels first, ours last
        grey = as_grey(image)
        keypoints = self.detector.detect(grey, self.n)
        return Features(keypoints, self.descriptor.describe(grey, keypoints), self.descriptor.norm)

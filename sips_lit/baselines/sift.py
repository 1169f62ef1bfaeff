"""SIFT's difference-of-Gaussians detector, with its own descriptor (Lowe 2004)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.detect.base import BaseDetector, best_keypoints
from sips_lit.types import Features, GreyImage, Keypoints

_SIZE_AT_FULL_RESOLUTION = 6.4
"""Diameter in pixels of the coarsest points of the octave at full resolution (2 x 1.6 x 2): their scale is 1."""


class SiftDetector(BaseDetector):
    """OpenCV's SIFT, with its defaults but for two.

    ``contrast_threshold`` is 0.01 instead of 0.04, so that dull images give enough points; it drops the weakest only
    and leaves the order alone. Precise upscaling is on: without it every point lies 0.25 px too far right and down.

    The scale of a point is its size relative to the coarsest points at full resolution, and at least 1.
    """

    name: str = "SIFT"
    describes: bool = True

    def __init__(self, contrast_threshold: float = 0.01) -> None:
        """Find blobs whose contrast is above ``contrast_threshold`` / 3 of the full range."""
        self.contrast_threshold = contrast_threshold

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points, best first; a point with several orientations counts once."""
        points = self._sift(0).detect(image, None)
        _, first = np.unique([(*point.pt, point.size) for point in points], axis=0, return_index=True)
        return _best([points[i] for i in first], n)[0]

    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """At most ``n`` features, best first; a point is as many features as it has orientations."""
        points, descriptors = self._sift(max(n, 1)).detectAndCompute(image, None)  # OpenCV reads 0 as no limit
        keypoints, rows = _best(points, n)  # OpenCV keeps more than n where scores are equal
        return Features(keypoints, descriptors[rows] if points else np.zeros((0, 128), np.float32), "l2")

    def _sift(self, n: int) -> Any:
        return cv2.SIFT.create(nfeatures=n, contrastThreshold=self.contrast_threshold, enable_precise_upscale=True)


def _best(points: Sequence[Any], n: int) -> tuple[Keypoints, NDArray[np.int64]]:
    rows = np.reshape([(*point.pt, point.response, point.size) for point in points], (-1, 4))
    return best_keypoints(rows[:, :2], rows[:, 2], np.maximum(1, rows[:, 3] / _SIZE_AT_FULL_RESOLUTION), n)

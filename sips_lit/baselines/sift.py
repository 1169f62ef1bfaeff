"""SIFT's difference-of-Gaussians detector, with its own descriptor (Lowe 2004)."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from sips_lit.baselines.cv_keypoints import attribute, positions
from sips_lit.detect.base import BaseDetector
from sips_lit.detect.ranking import best_keypoints, ranked
from sips_lit.types import Features, FloatArray, GreyImage, Keypoints

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
        _, first = np.unique(np.column_stack([positions(points), attribute(points, "size")]), axis=0, return_index=True)
        points = [points[i] for i in first]
        return best_keypoints(positions(points), attribute(points, "response"), _scale(points), n)

    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """At most ``n`` features, best first; a point is as many features as it has orientations."""
        if n <= 0:  # OpenCV reads 0 as no limit
            return Features(Keypoints.empty(), np.zeros((0, 128), np.float32), "l2")
        points, descriptors = self._sift(n).detectAndCompute(image, None)
        if not points:
            return Features(Keypoints.empty(), np.zeros((0, 128), np.float32), "l2")
        xy, score = positions(points), attribute(points, "response")
        best = ranked(xy, score, n)  # OpenCV keeps more than n where scores are equal
        keypoints = best_keypoints(xy, score, _scale(points), n)
        return Features(keypoints, np.asarray(descriptors)[best], "l2")

    def _sift(self, n: int) -> Any:
        return cv2.SIFT.create(nfeatures=n, contrastThreshold=self.contrast_threshold, enable_precise_upscale=True)


def _scale(points: Any) -> FloatArray:
    return np.maximum(1.0, attribute(points, "size") / _SIZE_AT_FULL_RESOLUTION)

"""The strongest corners of an image by a measure on its gradients: what Shi-Tomasi and Harris share."""

from __future__ import annotations

import cv2
import numpy as np

from sips_lit.detect.base import BaseDetector, best_keypoints
from sips_lit.types import GreyImage, Keypoints

_QUALITY = 1e-6  # of the strongest corner's measure: low, so that the budget alone cuts


class Corners(BaseDetector):
    """Whole pixels, none on the outermost row or column, and no two nearer than ``min_distance`` px.

    The score is the smaller eigenvalue of the gradient's 3 x 3 second-moment matrix, or Harris' measure of it (k = 0.04).
    """

    harris: bool = False

    def __init__(self, min_distance: float = 5.0) -> None:
        """Keep corners ``min_distance`` px apart."""
        self.min_distance = min_distance

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points, best first."""
        everywhere = np.full_like(image, 255)
        most = max(n, 1)  # OpenCV reads 0 as no limit
        corners, measure = cv2.goodFeaturesToTrackWithQuality(
            image, most, _QUALITY, self.min_distance, everywhere, useHarrisDetector=self.harris
        )
        if corners is None:
            return Keypoints.empty()
        return best_keypoints(corners.reshape(-1, 2), measure.reshape(-1), np.ones(len(corners)), n)[0]

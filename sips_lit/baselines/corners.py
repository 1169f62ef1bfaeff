"""The strongest corners of an image by a measure on its gradients: what Shi-Tomasi and Harris share."""

from __future__ import annotations

import cv2
import numpy as np

from sips_lit.detect.ranking import best_keypoints
from sips_lit.types import GreyImage, Keypoints

_QUALITY = 1e-6  # of the strongest corner's measure: low, so that the budget alone cuts


def strongest_corners(image: GreyImage, n: int, min_distance: float, harris: bool) -> Keypoints:
    """At most ``n`` corners, best first, no two nearer than ``min_distance`` px; the measure is the score.

    The measure is the smaller eigenvalue of the gradient's 3 x 3 second-moment matrix, or Harris' measure of it
    (k = 0.04). Points are whole pixels, and none lies on the outermost row or column.
    """
    if n <= 0:  # OpenCV reads 0 as no limit
        return Keypoints.empty()
    everywhere = np.full_like(image, 255)
    corners, measure = cv2.goodFeaturesToTrackWithQuality(
        image, n, _QUALITY, min_distance, everywhere, useHarrisDetector=harris
    )
    if corners is None:
        return Keypoints.empty()
    return best_keypoints(corners.reshape(-1, 2), measure.reshape(-1), np.ones(len(corners)), n)

"""FAST corners (Rosten and Drummond 2006)."""

from __future__ import annotations

import cv2
import numpy as np

from sips_lit.detect.base import BaseDetector, best_keypoints
from sips_lit.types import GreyImage, Keypoints


class Fast(BaseDetector):
    """OpenCV's FAST 9-16 with its 3 x 3 non-maximum suppression.

    The score is the largest ``threshold`` (grey levels) at which the point is still a corner; the low default fills
    the budget also in dull images and leaves the order alone.
    """

    name = "FAST"

    def __init__(self, threshold: int = 5) -> None:
        """Find corners that differ by more than ``threshold`` grey levels."""
        self.threshold = threshold

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points, best first."""
        points = cv2.FastFeatureDetector.create(threshold=self.threshold, nonmaxSuppression=True).detect(image, None)
        xy, score = cv2.KeyPoint.convert(points), np.array([point.response for point in points])
        return best_keypoints(np.reshape(xy, (-1, 2)), score, np.ones(len(points)), n)[0]

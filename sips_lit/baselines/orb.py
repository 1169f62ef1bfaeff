"""ORB: FAST on a pyramid, ranked by Harris' measure, with a binary descriptor (Rublee et al. 2011)."""

from __future__ import annotations

import cv2
import numpy as np

from sips_lit.detect.base import BaseDetector, best_keypoints
from sips_lit.types import Features, GreyImage, Keypoints

_STEP = 1.2  # between the levels of OpenCV's pyramid
_EDGE = 31  # OpenCV's margin without points, in pixels of the level


class OrbDetector(BaseDetector):
    """OpenCV's ORB with its defaults, but for a ``fast_threshold`` of 7 instead of 20, so that dull images give points.

    The scale of a point is that of its pyramid level. There are no points within 31 px (of the level) of the border.
    """

    name: str = "ORB"
    describes: bool = True

    def __init__(self, fast_threshold: int = 7) -> None:
        """Find corners that differ by more than ``fast_threshold`` grey levels."""
        self.fast_threshold = fast_threshold

    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """At most ``n`` features, best first; OpenCV divides n among the levels of the pyramid."""
        none = Features(Keypoints.empty(), np.zeros((0, 32), np.uint8), "hamming")
        if n <= 0 or min(image.shape) <= 2 * _EDGE:  # OpenCV fails on images too small for its pyramid
            return none
        orb = cv2.ORB.create(nfeatures=n, scaleFactor=_STEP, edgeThreshold=_EDGE, fastThreshold=self.fast_threshold)
        points, descriptors = orb.detectAndCompute(image, None)
        if not points:
            return none
        scale = _STEP ** np.array([point.octave for point in points])
        # OpenCV gives scale * x_level, as if levels shared the first pixel's centre; they hold whole numbers of pixels and
        # share its corner
        size = np.array(image.shape[::-1])
        level_size = np.rint(size / scale[:, None])
        xy = (cv2.KeyPoint.convert(points) / scale[:, None] + 0.5) * size / level_size - 0.5
        keypoints, rows = best_keypoints(xy, np.array([point.response for point in points]), scale, n)
        return Features(keypoints, descriptors[rows], "hamming")

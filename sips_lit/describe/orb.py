"""Upright ORB descriptors of given points (Rublee et al. 2011)."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.describe.scale_levels import scale_levels
from sips_lit.types import GreyImage, Keypoints, Norm

_EDGE = 31  # OpenCV drops points nearer to the border than this; the pattern and its blur reach less far


class OrbDescriptor:
    """Upright ORB: (N, 32) uint8, 256 packed bits. Scales are rounded to powers of sqrt(2)."""

    name: str = "ORB"
    norm: Norm = "hamming"

    def describe(self, image: GreyImage, keypoints: Keypoints) -> NDArray[Any]:
        """(N, 32) uint8, one row for each keypoint."""
        descriptors = np.zeros((len(keypoints), 32), np.uint8)
        for level in scale_levels(image, keypoints, shrink=1.0, margin=_EDGE + 1):
            points = [cv2.KeyPoint(float(x), float(y), _EDGE, angle=0) for x, y in level.xy]
            kept, rows = cv2.ORB.create(nlevels=1, edgeThreshold=_EDGE).compute(level.image, points)
            if len(kept) != len(points):
                raise RuntimeError(f"OpenCV's ORB described {len(kept)} of {len(points)} points")
            descriptors[level.rows] = rows
        return descriptors

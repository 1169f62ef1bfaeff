"""Points as OpenCV's ``KeyPoint``."""

from __future__ import annotations

import cv2

from sips_lit.types import OPENCV_DIAMETER, Keypoints


def opencv_keypoints(keypoints: Keypoints, diameter: float = OPENCV_DIAMETER) -> list[cv2.KeyPoint]:
    """N OpenCV keypoints: `Keypoints.to_opencv` as a function."""
    return keypoints.to_opencv(diameter)

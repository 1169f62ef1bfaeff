"""Points as OpenCV's ``KeyPoint``."""

from __future__ import annotations

from typing import Final

import cv2

from sips_lit.types import Keypoints

DIAMETER: Final = 8.0
"""Pixels at scale 1 of the neighbourhood that OpenCV's descriptors are told: that of `RootSift`."""


def opencv_keypoints(keypoints: Keypoints, diameter: float = DIAMETER) -> list[cv2.KeyPoint]:
    """N OpenCV keypoints in the same order and pixels, upright (angle 0), with the scores as responses.

    ``size`` is ``diameter`` (pixels) times the scale of the point.
    """
    rows = zip(keypoints.xy.tolist(), keypoints.score.tolist(), keypoints.scale.tolist(), strict=True)
    return [cv2.KeyPoint(x, y, diameter * scale, angle=0, response=score) for (x, y), score, scale in rows]

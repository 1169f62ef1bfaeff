"""Shi-Tomasi corners, "good features to track" (Shi and Tomasi 1994)."""

from __future__ import annotations

from sips_lit.baselines.corners import strongest_corners
from sips_lit.detect.base import BaseDetector
from sips_lit.types import GreyImage, Keypoints


class ShiTomasi(BaseDetector):
    """Corners by the smaller eigenvalue, no two nearer than ``min_distance`` px."""

    name = "Shi-Tomasi"

    def __init__(self, min_distance: float = 5.0) -> None:
        """Keep corners ``min_distance`` px apart."""
        self.min_distance = min_distance

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points, best first."""
        return strongest_corners(image, n, self.min_distance, harris=False)

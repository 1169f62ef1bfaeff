"""Succinct interest points: the fewest points that still give k inlier correspondences."""

from sips_lit.detect.detector import SipsDetector
from sips_lit.types import Keypoints

__all__ = ["Keypoints", "SipsDetector"]

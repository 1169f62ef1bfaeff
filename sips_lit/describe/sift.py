"""Upright SIFT and RootSIFT descriptors of given points (Lowe 2004; Arandjelovic and Zisserman 2012)."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.describe.scale_levels import LARGEST_RESIDUE, scale_levels
from sips_lit.errors import BadInputError
from sips_lit.types import GreyImage, Keypoints, Norm

_BLUR_REACH = 6  # half the kernel of the blur with which SIFT begins


class SiftDescriptor:
    """Upright SIFT: (N, 128) float32, as OpenCV gives it (integers, length about 512, all zero where nothing varies).

    ``size`` is OpenCV's keypoint diameter in pixels at scale 1; the 4 x 4 cells are 1.5 times as wide, so that the
    support is a square of 6 x size. It is described on an image ``shrink`` times smaller: on videos, matches are as
    good with 2 as with 1, at a quarter of the time.
    """

    name: str = "SIFT"
    norm: Norm = "l2"

    def __init__(self, size: float = 8.0, shrink: float = 2.0) -> None:
        """Raises BadInputError where ``size`` is not positive or ``shrink`` is below 1."""
        if not size > 0:
            raise BadInputError(
                f"The descriptor's size is {size}; give a diameter in pixels above 0 (the default is 8)."
            )
        if not shrink >= 1:
            raise BadInputError(f"The descriptor's shrink is {shrink}; give a factor of 1 or more (the default is 2).")
        self.size = size
        self.shrink = shrink

    def describe(self, image: GreyImage, keypoints: Keypoints) -> NDArray[Any]:
        """(N, 128) float32, one row for each keypoint."""
        descriptors = np.zeros((len(keypoints), 128), np.float32)
        diameter = self.size / self.shrink
        cell = 1.5 * diameter * LARGEST_RESIDUE
        margin = math.ceil(2.5 * cell) + 2 + _BLUR_REACH  # 2: gradient and rounding to whole pixels
        for level in scale_levels(image, keypoints, self.shrink, margin):
            points = [
                cv2.KeyPoint(x, y, width, angle=0)
                for (x, y), width in zip(level.xy.tolist(), (diameter * level.residue).tolist(), strict=True)
            ]
            # A new object each time costs under a microsecond, and none is shared between threads.
            descriptors[level.rows] = cv2.SIFT.create().compute(level.image, points)[1]
        return descriptors


class RootSift(SiftDescriptor):
    """Upright RootSIFT: (N, 128) float32 of length 1 (all zero where nothing varies); arguments as of `SiftDescriptor`."""

    name = "RootSIFT"

    def describe(self, image: GreyImage, keypoints: Keypoints) -> NDArray[Any]:
        """(N, 128) float32, one row for each keypoint."""
        descriptors = super().describe(image, keypoints)
        total = descriptors.sum(axis=1, keepdims=True)
        # A descriptor of whole numbers sums to 0, or to 1 and more.
        rooted: NDArray[np.float32] = np.sqrt(descriptors / np.maximum(total, 1))
        return rooted

"""Turning and scaling each image of a planar pair by itself (paper, HPatches training)."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.types import FramePair, GreyImage

SHARPNESS = 0.5  # pixels: the standard deviation of the blur that one pixel is taken to have


def turn_and_scale(image: GreyImage, angle: float, scale: float) -> tuple[GreyImage, NDArray[np.float64]]:
    """The image (H, W) turned by ``angle`` radians (from x to y) and scaled about its centre, and its map (3, 3).

    The result is cut to the largest upright rectangle inside the turned image and grows or shrinks with the scale. So no
    pixel comes from outside of the photograph: filled corners would have edges that turn with the image and match like
    texture, and a mirrored fill shows real texture with wrong labels. What the cut costs is area: at 1 radian
    it leaves two fifths of a 4:3 image.
    """
    height, width = image.shape
    across, down = _largest_inside(width - 1, height - 1, angle)  # from pixel centre to pixel centre
    size = (math.floor(scale * across) + 1, math.floor(scale * down) + 1)
    c, s = scale * math.cos(angle), scale * math.sin(angle)
    A = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    A[:2, 2] = (np.array(size) - 1) / 2 - A[:2, :2] @ [(width - 1) / 2, (height - 1) / 2]
    if scale < 1:  # else fine texture aliases
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), SHARPNESS * math.sqrt(scale**-2 - 1)), np.uint8)
    turned = cv2.warpAffine(image, A[:2], size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(turned, np.uint8), A


def turn_and_scale_pair(pair: FramePair, angles: tuple[float, float], scales: tuple[float, float]) -> FramePair:
    """The pair with each of its two images turned and scaled by itself; its homography follows exactly.

    Raises ValueError for a pair without a homography, and one with more than that: frames between, poses or depth.
    """
    if pair.homography is None or pair.geometry is not None or len(pair.frames) != 2:
        raise ValueError(
            f"{pair.name}: only the two images of a pair that nothing but a homography joins can be turned"
        )
    image0, A0 = turn_and_scale(pair.image0, angles[0], scales[0])
    image1, A1 = turn_and_scale(pair.image1, angles[1], scales[1])
    H = A1 @ pair.homography @ np.linalg.inv(A0)
    return replace(pair, frames=(image0, image1), image0=image0, image1=image1, homography=H)


def _largest_inside(width: float, height: float, angle: float) -> tuple[float, float]:
    """Width and height of the upright rectangle of largest area inside a rectangle that is turned about its centre."""
    s, c = abs(math.sin(angle)), abs(math.cos(angle))
    short, long = min(width, height), max(width, height)
    if short <= 2 * s * c * long:  # two corners touch the long sides, the others lie inside
        across, down = (short / 2 / s, short / 2 / c) if width >= height else (short / 2 / c, short / 2 / s)
        return across, down
    cos_double = c * c - s * s  # all four corners touch
    return (width * c - height * s) / cos_double, (height * c - width * s) / cos_double

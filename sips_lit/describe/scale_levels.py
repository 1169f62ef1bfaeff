"""Shrunk, edge-padded copies of an image on which points of every scale have about the same size.

A descriptor that looks at a patch of fixed size gets a support that grows with the scale of the point, without aliasing
and without an ever larger border: the image shrinks instead, in steps of sqrt(2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.types import GreyImage, Keypoints

LARGEST_RESIDUE = 2**0.25
"""The levels are sqrt(2) apart and a point takes the nearest one: it differs from its level by this much at most."""


@dataclass(frozen=True, slots=True)
class ScaleLevel:
    """One copy of an image, and the points that are described on it.

    ``image`` (H', W') is ``factor`` times smaller than the original, plus the margin; ``xy`` (M, 2) float32 are the
    points in it; ``residue`` (M,) is how much larger than the level a point is; ``rows`` (M,) are the indices of the
    points among all keypoints.
    """

    image: GreyImage
    factor: float
    xy: NDArray[np.float32]
    residue: NDArray[np.float64]
    rows: NDArray[np.int64]


def scale_levels(image: GreyImage, keypoints: Keypoints, shrink: float, margin: float) -> Iterator[ScaleLevel]:
    """Groups ``keypoints`` by scale; one `ScaleLevel` for each group, points in their order.

    A point of scale s is described where the image is ``shrink * s`` times smaller, rounded to a power of sqrt(2), and
    never on an enlarged image. ``margin`` is how far, in pixels of the level, the support of a descriptor reaches:
    the image is padded by repeating its edge so that every point has that much around it.
    """
    wanted = shrink * keypoints.scale.astype(np.float64)
    steps = np.maximum(0, np.rint(2 * np.log2(wanted))).astype(np.int64)
    for step in np.unique(steps):
        rows = np.flatnonzero(steps == step)
        factor = 2 ** (int(step) / 2)
        level, xy, left = image, keypoints.xy[rows].astype(np.float64), factor
        while left > 4:  # padding first would make huge images of large points
            level, xy = _pad_and_resize(level, xy, 2, 0)
            left /= 2
        level, xy = _pad_and_resize(level, xy, left, math.ceil(margin))
        yield ScaleLevel(level, factor, xy.astype(np.float32), wanted[rows] / factor, rows)


def _pad_and_resize(
    image: GreyImage, xy: NDArray[np.float64], factor: float, margin: int
) -> tuple[GreyImage, NDArray[np.float64]]:
    """``image`` made ``factor`` times smaller with ``margin`` (pixels of the result) around it, and ``xy`` in it."""
    size = np.array(image.shape[::-1])
    before = math.ceil(margin * factor)
    small = np.ceil((size + 2 * before) / factor).astype(int)
    large = np.rint(small * factor).astype(int)  # so that the ratio of the sizes is the factor, for any image size
    right, bottom = (large - size - before).tolist()
    padded = cv2.copyMakeBorder(image, before, bottom, before, right, cv2.BORDER_REPLICATE)
    if factor != 1:
        padded = cv2.resize(padded, small.tolist(), interpolation=cv2.INTER_AREA)
    return padded.astype(np.uint8, copy=False), (xy + before + 0.5) * small / large - 0.5

"""Traces of half pixels: a detector's offset, from points of photographs and of the same photographs at other sizes."""

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
import pytest

from sips_lit.types import Detector, FloatArray, GreyImage

_SIZES: Final = (0.5, 0.6, 0.7, 0.8, 1.25, 1.5)  # factors
_OFFSETS: Final = np.arange(-1.5, 1.51, 0.25)  # pixels that are tried
_NEAR: Final = 0.75  # pixels of the coarser image


def photographs() -> list[GreyImage]:
    """Seven that come with scikit-image, 300 to 512 pixels high."""
    data = pytest.importorskip("skimage.data", reason="scikit-image has the photographs")
    left, _, _ = data.stereo_motorcycle()
    colour = [data.astronaut(), data.coffee(), left, data.chelsea(), data.rocket(), data.immunohistochemistry()]
    return [data.camera(), *(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in colour)]


def parts_of_two() -> list[GreyImage]:
    """A part of 320 x 384 pixels of two of them."""
    return [np.ascontiguousarray(image[:320, 60:444]) for image in photographs()[:2]]


def zoom_offset(detector: Detector, images: Sequence[GreyImage], n: int = 500) -> FloatArray:
    """(dx, dy): how far from its points a detector says that they are, in pixels of the image that it is given.

    It is what must be taken off for the points of an image and those of the same image resized about its edges,
    x -> (x + 0.5) s - 0.5, to agree most often. Offsets that cancel in shifts show here.
    """
    agree = np.zeros((2, len(_OFFSETS)))
    for image in images:
        here = detector.detect(image, n).xy.astype(float)
        for factor in _SIZES:
            width, height = (round(size * factor) for size in image.shape[::-1])
            way = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
            there = detector.detect(cv2.resize(image, (width, height), interpolation=way), n).xy.astype(float)
            ratio = np.array([width, height]) / image.shape[::-1]
            near = _NEAR * max(1, 1 / factor)
            for axis in (0, 1):
                for at, offset in enumerate(_OFFSETS):
                    taken_off = offset * np.eye(2)[axis]
                    apart = ((there - taken_off + 0.5) / ratio - 0.5)[:, None] - (here - taken_off)
                    agree[axis, at] += (np.hypot(*np.moveaxis(apart, 2, 0)).min(axis=1) < near).sum()
    return np.array([_peak(counts) for counts in agree])


def _peak(counts: FloatArray) -> float:
    """The offset of most agreements, by a parabola through all counts within a pixel of the best: steps are coarse."""
    near = np.abs(_OFFSETS - _OFFSETS[counts.argmax()]) <= 1
    second, first, _ = np.polyfit(_OFFSETS[near], counts[near], 2)
    return float(-first / (2 * second))

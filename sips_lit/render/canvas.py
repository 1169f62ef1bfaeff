"""Drawing on RGB pictures: uint8 (H, W, 3), changed in place, at sub-pixel positions."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.types import FloatArray

Picture = NDArray[np.uint8]
"""(H, W, 3) uint8 RGB."""
Colour = tuple[int, int, int]
"""RGB."""

BLACK: Final[Colour] = (0, 0, 0)
WHITE: Final[Colour] = (255, 255, 255)
DARK: Final = 110
"""Luma of colours that black does not set off."""
_FONT: Final = cv2.FONT_HERSHEY_SIMPLEX
_SHIFT: Final = 4  # OpenCV takes positions in sixteenths of a pixel


def to_picture(image: NDArray[np.uint8]) -> Picture:
    """An RGB copy to draw on of a grey (H, W) or RGB (H, W, 3) image."""
    return np.repeat(image[:, :, None], 3, axis=2) if image.ndim == 2 else image.copy()


def probability_colours(probability: FloatArray) -> Picture:
    """Viridis, which grows evenly to the eye, of probabilities (…,) in [0, 1]: uint8 (…, 3). Others are clipped."""
    level = np.rint(np.clip(probability, 0, 1) * 255).astype(np.uint8)
    table = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_VIRIDIS).astype(np.uint8)
    return table[:, 0, ::-1][level]


def draw_ring(
    picture: Picture, centre: FloatArray, radius: float, thickness: float, colour: Colour, opacity: float = 1.0
) -> None:
    """A circle line of any, also fractional, ``thickness``; what lies outside the picture is cut off.

    ``thickness`` of twice the radius and more is a disc. Smoothed by the distance of each pixel centre to the line, as
    OpenCV's circles are a whole number of pixels thick and would show only a few levels of probability.
    """
    height, width = picture.shape[:2]
    x, y = float(centre[0]), float(centre[1])
    reach = radius + thickness / 2 + 1
    left, right = max(int(np.floor(x - reach)), 0), min(int(np.ceil(x + reach)) + 1, width)
    top, bottom = max(int(np.floor(y - reach)), 0), min(int(np.ceil(y + reach)) + 1, height)
    if left >= right or top >= bottom:
        return
    from_centre = np.hypot(np.arange(left, right) - x, np.arange(top, bottom)[:, None] - y)
    cover = opacity * np.clip(thickness / 2 + 0.5 - np.abs(from_centre - radius), 0, 1)[:, :, None]
    region = picture[top:bottom, left:right]
    region[:] = np.rint(region + cover * (np.array(colour) - region))


def draw_point(
    picture: Picture, centre: FloatArray, radius: float, probability: float, colour: Colour, scale: float = 1.0
) -> None:
    """A circle as thick as the point is probable, on a wider rim of the opposite tone: one of them shows on any ground.

    ``scale`` multiplies the thickness, for pictures that are shown smaller than they are.
    """
    thickness = (1.0 + 2.5 * float(np.clip(probability, 0, 1))) * scale
    draw_ring(picture, centre, radius, thickness + 2 * scale, opposite(colour))
    draw_ring(picture, centre, radius, thickness, colour)


def opposite(colour: Colour) -> Colour:
    """Black under bright colours, white under dark ones."""
    red, green, blue = colour
    return BLACK if 0.299 * red + 0.587 * green + 0.114 * blue > DARK else WHITE  # luma (ITU-R BT.601)


def draw_lines(
    picture: Picture, starts: FloatArray, ends: FloatArray, colour: Colour, opacity: float, thickness: int = 1
) -> None:
    """Straight lines from ``starts`` (M, 2) to ``ends`` (M, 2), each seen through the ones above it."""
    reach = 2 + thickness
    for start, end in zip(_sixteenths(starts), _sixteenths(ends), strict=True):
        left, top = np.maximum(np.minimum(start, end) // 2**_SHIFT - reach, 0)
        right, bottom = np.maximum(start, end) // 2**_SHIFT + reach + 1
        region = picture[top:bottom, left:right]
        line = np.zeros(region.shape[:2], np.uint8)
        corner = np.array([left, top]) * 2**_SHIFT
        p, q = (start - corner).tolist(), (end - corner).tolist()
        cv2.line(line, p, q, 255, thickness, cv2.LINE_AA, _SHIFT)
        touched = line > 0
        cover = line[touched, None] * (opacity / 255)
        region[touched] = np.rint(region[touched] + cover * (np.array(colour) - region[touched]))


def _sixteenths(points: FloatArray) -> NDArray[np.int64]:
    return np.rint(points * 2**_SHIFT).astype(np.int64)


def draw_text(picture: Picture, text: str, left: int, baseline: int, size: float, colour: Colour = WHITE) -> int:
    """Text of about ``size`` pixels from its left end on its baseline; returns the x where it ends."""
    cv2.putText(picture, text, (left, baseline), _FONT, size / 22, colour, _stroke(size), cv2.LINE_AA)
    return left + text_width(text, size)


def text_width(text: str, size: float) -> int:
    """How many pixels wide `draw_text` makes it."""
    (width, _), _ = cv2.getTextSize(text, _FONT, size / 22, _stroke(size))
    return int(width)


def _stroke(size: float) -> int:
    return max(1, round(size / 16))

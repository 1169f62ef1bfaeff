"""The part of their range that 16-bit images use: thermal cameras and sensors of 10 or 12 bits use little of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.types import GreyImage

SAMPLE = 16  # images of a sequence that are looked at
OUTLIERS = 0.1  # percent of the pixels at each end that may be dead or hot
MARGIN = 0.1  # of the range that was found, added at both ends: other images may be darker or brighter
WIDE = 2**15  # images that use half of the range or more are scaled by all of it


@dataclass(frozen=True, slots=True)
class Span:
    """The 16-bit values ``low`` to ``high`` become 0 to 255."""

    low: int = 0
    high: int = 2**16 - 1

    def __call__(self, values: NDArray[np.uint16]) -> GreyImage:
        """8-bit values of the same shape."""
        scaled = (np.clip(values, self.low, self.high) - np.float64(self.low)) * 255 / (self.high - self.low)
        return np.asarray(scaled + 0.5, np.uint8)

    def notes(self) -> list[str]:
        """What one should know: nothing of images of 8 bits, or that use all 16."""
        return [] if self == FULL else [f"16-bit values, of which {self.low} to {self.high} become 0 to 255"]


FULL: Final = Span()
"""All 16 bits."""


def find_span(count: int, read: Callable[[int], NDArray[Any]]) -> Span:
    """The one span of a sequence of ``count`` images, whose image i ``read`` gives as stored; by a sample spread over it.

    `FULL` where images have 8 bits or use much of their 16. Images that ``read`` refuses are passed over. Our choice: a
    range for each image would change the contrast from frame to frame, and with it the points.
    """
    lows, highs = [], []
    for index in np.unique(np.linspace(0, count - 1, min(count, SAMPLE)).round().astype(int)):
        try:
            values = read(int(index))
        except BadInputError:
            continue
        if values.dtype != np.uint16:
            return FULL
        low, high = np.percentile(values, (OUTLIERS, 100 - OUTLIERS), method="nearest")
        lows.append(int(low))
        highs.append(int(high))
    if not lows or max(highs) - min(lows) >= WIDE or max(highs) == min(lows):
        return FULL
    margin = round(MARGIN * (max(highs) - min(lows)))
    return Span(max(0, min(lows) - margin), min(FULL.high, max(highs) + margin))

"""The logits that points are detected by: what a network learned to give, and what is added to it without learning."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from torch import Tensor

from sips_lit.detect.corners import corner_strength
from sips_lit.detect.octaves import OCTAVE_STEPS, mean_over_octaves

# a damaged checkpoint may ask for any number
MOST_OCTAVES: Final = 8
MOST_OF_CORNERS: Final = 10


@dataclass(frozen=True, slots=True)
class Detection:
    """How points are detected, which training knows nothing of; by default as a network learns.

    ``octaves``: how many a pixel's logit is the mean of; ``first_octave``: the largest of them, 0 the image, 1 half of it,
    which takes a quarter of the time; ``octave_step``: from each to the next, 0.5 for those between, too (0.5 is two thirds
    of the image); ``corners``: weight of how much of a corner there is around a pixel, and ``fine_corners`` close around
    it, which says where a point is that was found in a smaller image (see `sips_lit.detect.corners`).

    ``whole_below``: an image of fewer pixels (H x W) is scored from itself on (see `of`): half of it is too little to see,
    and all of it is soon scored. 0: none is (our choice).

    Raises ValueError for numbers out of range.
    """

    octaves: int = 1
    first_octave: float = 0
    octave_step: float = 1
    corners: float = 0.0
    fine_corners: float = 0.0
    whole_below: int = 0

    def __post_init__(self) -> None:
        if self.octaves not in range(1, MOST_OCTAVES + 1):
            raise ValueError(f"a score network sees 1 to {MOST_OCTAVES} octaves, not {self.octaves}")
        if self.octave_step not in OCTAVE_STEPS:
            raise ValueError(f"octave_step is 1 or 0.5, not {self.octave_step}")
        last = MOST_OCTAVES - 1
        if not 0 <= self.first_octave <= last or self.first_octave % 0.5:
            raise ValueError(f"the first octave is 0 (the image) to {last}, in steps of 0.5, not {self.first_octave}")
        for name, weight in (("corners", self.corners), ("fine_corners", self.fine_corners)):
            if not 0 <= weight <= MOST_OF_CORNERS:
                raise ValueError(f"{name} weigh 0 to {MOST_OF_CORNERS}, not {weight}")
        if not isinstance(self.whole_below, int) or self.whole_below < 0:
            raise ValueError(f"whole_below is a number of pixels, 0 or more, not {self.whole_below}")

    def of(self, height: int, width: int) -> Detection:
        """How points of an image of that size are detected.

        A small one is scored from itself down to the octave that is the last of larger ones. It then says by itself where a
        point is, without corners close around it.
        """
        if self.first_octave == 0 or self.whole_below == 0 or height * width >= self.whole_below:
            return self
        more = math.ceil(self.first_octave / self.octave_step)
        return replace(self, octaves=min(self.octaves + more, MOST_OCTAVES), first_octave=0, fine_corners=0.0)


def detection_logits(logits_of: Callable[[Tensor], Tensor], image: Tensor, by: Detection) -> Tensor:
    """Logits (B, 1, H, W) of images (B, 1, H, W): the mean over octaves, and what ``by`` adds for corners."""
    by = by.of(image.shape[-2], image.shape[-1])
    logits = mean_over_octaves(logits_of, image, by.octaves, by.first_octave, by.octave_step)
    if by.corners or by.fine_corners:
        logits = logits + corner_strength(image, by.corners, by.fine_corners)
    return logits

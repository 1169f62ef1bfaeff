"""Forward-backward KLT: sparse optical flow that must lead back to where it began (paper, label generation)."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.types import GreyImage


@dataclass(frozen=True, slots=True)
class KltTracker:
    """Lucas-Kanade with pyramids and the forward-backward check.

    ``window``: side of the patch in pixels; ``max_level``: pyramid levels above the image; ``iterations`` a level at most,
    fewer once an update is below ``accuracy`` pixels; ``max_roundtrip``: a step holds if tracking forward and backward
    returns within this many pixels; ``margin``: and if the point stays this far inside the image.

    Raises BadInputError for a patch or a pyramid that there is not.
    """

    window: int = 15
    max_level: int = 3
    iterations: int = 15
    accuracy: float = 0.03
    max_roundtrip: float = 1.0
    margin: float = 4.0

    def __post_init__(self) -> None:
        for name, value, least in (("window", self.window, 3), ("max_level", self.max_level, 0)):
            if value < least:
                raise BadInputError(f"{name} of the tracker is {value}: give {least} or more")

    @property
    def parameters(self) -> Mapping[str, Any]:
        """What a track depends on, with the version of OpenCV."""
        return {**asdict(self), "opencv": cv2.__version__}

    def step(
        self, image0: GreyImage, image1: GreyImage, xy: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Where N points (N, 2) of image 0 are in image 1, and which of these tracks hold (N,)."""
        if not len(xy):
            return xy.reshape(0, 2), np.zeros(0, np.bool_)
        no_guess: Any = None  # OpenCV's type stubs do not know that it may be left out
        stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, self.iterations, self.accuracy)
        options: dict[str, Any] = {"winSize": (self.window, self.window), "maxLevel": self.max_level, "criteria": stop}
        forth, found, _ = cv2.calcOpticalFlowPyrLK(image0, image1, xy, no_guess, **options)
        back, found_back, _ = cv2.calcOpticalFlowPyrLK(image1, image0, forth, no_guess, **options)
        height, width = image1.shape
        high = np.array([width, height], np.float32) - 1 - self.margin
        returns = ((back - xy) ** 2).sum(1) <= self.max_roundtrip**2
        inside = ((forth >= self.margin) & (forth <= high)).all(1)
        holds: NDArray[np.bool_] = returns & inside & (found.ravel() > 0) & (found_back.ravel() > 0)
        return np.asarray(forth, np.float32), holds

    def track(
        self, frames: Sequence[GreyImage], xy: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Tracks N points (N, 2) of the first frame through all others.

        Returns their places in the last frame (N, 2), NaN where lost, and which survived every step (N,).
        """
        alive = np.arange(len(xy))
        places = np.ascontiguousarray(xy, np.float32)
        for image0, image1 in itertools.pairwise(frames):
            places, held = self.step(image0, image1, places)
            alive, places = alive[held], places[held]
        ends = np.full((len(xy), 2), np.nan, np.float32)
        ends[alive] = places
        survived = np.zeros(len(xy), np.bool_)
        survived[alive] = True
        return ends, survived

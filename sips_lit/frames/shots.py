"""Cuts between the shots of a video."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from sips_lit.frames.images import resize_max_side
from sips_lit.tracking.klt import KltTracker
from sips_lit.types import GreyImage

THUMBNAIL = 200  # pixels of the longer side
SURVIVAL = 0.2  # at a cut less than this fraction of the tracks survives (by chance)
CHANGE = 0.8  # and the pictures correlate less than this


def find_cuts(frames: Iterable[GreyImage]) -> list[int]:
    """Index of the first frame of every new shot.

    A cut is where hardly any track survives the step and the pictures hardly correlate. A pan keeps its tracks and a change
    of light keeps the correlation, so neither is taken for a cut.
    """
    tracker = KltTracker(window=15, max_level=3, margin=1.0)
    cuts: list[int] = []
    previous: GreyImage | None = None
    for index, frame in enumerate(frames):
        small = resize_max_side(frame, THUMBNAIL)
        if (
            previous is not None
            and _correlation(previous, small) < CHANGE
            and _survival(tracker, previous, small) < SURVIVAL
        ):
            cuts.append(index)
        previous = small
    return cuts


def _correlation(image0: GreyImage, image1: GreyImage) -> float:
    """Correlation of two pictures after blur; 1 for two without any contrast."""
    a, b = (cv2.GaussianBlur(image, (0, 0), 3).astype(np.float64) for image in (image0, image1))
    a, b = a - a.mean(), b - b.mean()
    norm = np.sqrt((a * a).sum() * (b * b).sum())
    return float((a * b).sum() / norm) if norm > 0 else float(a.std() == b.std())


def _survival(tracker: KltTracker, image0: GreyImage, image1: GreyImage) -> float:
    """Fraction of the corners that forward-backward KLT tracks; 0 if there are none to track."""
    corners = cv2.goodFeaturesToTrack(image0, 150, 0.01, 5)
    if corners is None:
        return 0.0
    _, held = tracker.step(image0, image1, corners.reshape(-1, 2).astype(np.float32))
    return float(held.mean())

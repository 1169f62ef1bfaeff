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
MATCHED = 320  # pixels of the longer side where features are matched
AGREEING = (
    12  # matches that one similarity explains; pictures of different takes have at most 8, frames in a fast turn 100
)


def find_cuts(frames: Iterable[GreyImage]) -> list[int]:
    """Index of the first frame of every new shot.

    A cut is where hardly any track survives the step, the pictures hardly correlate, and features of one are not found in
    the other. A pan keeps its tracks, a change of light the correlation and a fast turn its features (thresholds ours).
    """
    tracker = KltTracker(window=15, max_level=3, margin=1.0)
    cuts: list[int] = []
    previous: tuple[GreyImage, GreyImage] | None = None
    for index, frame in enumerate(frames):
        small = resize_max_side(frame, THUMBNAIL)
        if (
            previous is not None
            and _correlation(previous[1], small) < CHANGE
            and _survival(tracker, previous[1], small) < SURVIVAL
            and _agreeing(previous[0], frame) < AGREEING
        ):
            cuts.append(index)
        previous = frame, small
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


def _agreeing(image0: GreyImage, image1: GreyImage) -> int:
    """How many mutual nearest SIFT features of both images one similarity maps onto each other within 4 pixels."""
    sift = cv2.SIFT.create(300)
    (points0, described0), (points1, described1) = (
        sift.detectAndCompute(resize_max_side(image, MATCHED), None) for image in (image0, image1)
    )
    if described0 is None or described1 is None:
        return 0
    matches = cv2.BFMatcher(cv2.NORM_L2, crossCheck=True).match(described0, described1)
    if len(matches) < AGREEING:
        return 0
    xy0 = np.array([points0[match.queryIdx].pt for match in matches])
    xy1 = np.array([points1[match.trainIdx].pt for match in matches])
    _, agrees = cv2.estimateAffinePartial2D(xy0, xy1, ransacReprojThreshold=4)
    return 0 if agrees is None else int(agrees.sum())

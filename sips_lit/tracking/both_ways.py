"""Tracks in both directions of a video at less than half the cost of tracking twice: the way back retraces the way forth."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.tracking.klt import KltTracker
from sips_lit.types import GreyImage

SMALL_MOTION: Final = 8.0
"""Pixels a frame: faster points are searched through the pyramid, where a guess would find more than it does."""
STEADY: Final = 1.5
"""Pixels a frame by which the move of a steady point may differ from its move before."""
NEAR: Final = 4.0
"""Pixels from where it would be within which a point that is searched there may be found."""
MOST: Final = 0.7
"""Share of the points that must be steady for all to be searched where they would be, and be found near it to be trusted."""


@dataclass(frozen=True, slots=True)
class Tracks:
    """``ends`` (N, 2) in the last frame, NaN where lost; ``survived`` (N,) bool; ``moves`` (F - 1, N, 2) of each step."""

    ends: NDArray[np.float32]
    survived: NDArray[np.bool_]
    moves: NDArray[np.float32]


def follow(tracker: KltTracker, frames: Sequence[GreyImage], xy: NDArray[np.float32]) -> Tracks:
    """Tracks N points (N, 2) of the first of F frames through all others.

    As `KltTracker.track`, but the way back of each step is searched around its start, in the full image alone: a quarter of
    the cost. It notices points that are hidden or drift, not one that another point resembles so much that either could be
    meant. Where most points moved steadily in the step before, so is the way forth, around where it would lead (our choice).
    """
    alive, places = np.arange(len(xy)), np.ascontiguousarray(xy, np.float32)
    moves = np.full((len(frames) - 1, len(xy), 2), np.nan, np.float32)
    before = np.full((len(xy), 2), np.nan, np.float32)  # the moves of the last step
    steady = False  # whether most of them were as those of the step before it
    for move, (image0, image1) in zip(moves, itertools.pairwise(frames), strict=True):
        if steady:
            reached, held = _going_on(tracker, image0, image1, places, places + before[alive])
        else:
            reached, held = _step(tracker, image0, image1, places)
        move[alive[held]] = (reached - places)[held]
        alive, places = alive[held], reached[held]
        steady = bool(np.count_nonzero(_within(move[alive], before[alive], STEADY)) >= MOST * len(alive))
        before = move
    return Tracks(*_of_all(len(xy), alive, places), moves)


def retrace(
    tracker: KltTracker, frames: Sequence[GreyImage], xy: NDArray[np.float32], moves: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Tracks N points (N, 2) of the first of F frames, each near the end of a track that came the other way (our choice).

    ``moves`` (F - 1, N, 2) are those of these tracks, in the order in which they are now undone. A step starts where undoing
    a move leads, in the full image alone, and holds if it ends within ``max_roundtrip`` pixels of that: it is the way back
    of the other track's step. Other steps, and those of more than `SMALL_MOTION` pixels, are searched as those of `follow`
    are. Returns the places in the last frame (N, 2), NaN where lost, and which survived every step (N,).
    """
    alive, places = np.arange(len(xy)), np.ascontiguousarray(xy, np.float32)
    for (image0, image1), move in zip(itertools.pairwise(frames), moves, strict=True):
        undone = places - move[alive]
        reached, held = _near_guess(tracker, image0, image1, places, undone, tracker.max_roundtrip)
        again = np.flatnonzero(~held)
        if len(again):
            reached[again], held[again] = _step(tracker, image0, image1, places[again])
        alive, places = alive[held], reached[held]
    return _of_all(len(xy), alive, places)


def _going_on(
    tracker: KltTracker,
    image0: GreyImage,
    image1: GreyImage,
    xy: NDArray[np.float32],
    expected: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """A step of N points (N, 2), as `_step`, of which most are expected near others (N, 2) in image 1.

    They are searched there in the full image, and hold if they are found within `NEAR` pixels of it and the way back leads
    to their start. Others, and those expected to move by more than `SMALL_MOTION` pixels, are searched through the pyramid;
    so are all where most are not found near, since the camera has turned, and what the few have found resembles them.
    """
    reached, held = _near_guess(tracker, image0, image1, xy, expected, NEAR)
    held &= bool(np.count_nonzero(held) >= MOST * len(held))
    held[held] = _return(tracker, image0, image1, xy[held], reached[held])
    again = np.flatnonzero(~held)
    if len(again):
        reached[again], held[again] = _step(tracker, image0, image1, xy[again])
    return reached, held


def _step(
    tracker: KltTracker, image0: GreyImage, image1: GreyImage, xy: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    reached, found = _flow(tracker, image0, image1, xy)
    held = found & _inside(tracker, image1, reached)
    held[held] = _return(tracker, image0, image1, xy[held], reached[held])
    return reached, held


def _near_guess(
    tracker: KltTracker,
    image0: GreyImage,
    image1: GreyImage,
    xy: NDArray[np.float32],
    guess: NDArray[np.float32],
    most: float,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where N points are in image 1, searched around guesses (N, 2), and which are in it within ``most`` pixels of these.

    Points that would move by more than `SMALL_MOTION` pixels are not searched, and do not hold.
    """
    slow = np.flatnonzero(_within(guess, xy, SMALL_MOTION))
    reached, held = xy.copy(), np.zeros(len(xy), np.bool_)
    reached[slow], found = _flow(tracker, image0, image1, xy[slow], guess[slow])
    held[slow] = found & _within(reached[slow], guess[slow], most) & _inside(tracker, image1, reached[slow])
    return reached, held


def _return(
    tracker: KltTracker,
    image0: GreyImage,
    image1: GreyImage,
    xy: NDArray[np.float32],
    reached: NDArray[np.float32],
) -> NDArray[np.bool_]:
    """Which of N points (N, 2) of image 0 the way back from where they are in image 1 leads to again."""
    back, found = _flow(tracker, image1, image0, reached, xy)
    return found & _within(back, xy, tracker.max_roundtrip)


def _flow(
    tracker: KltTracker,
    image0: GreyImage,
    image1: GreyImage,
    xy: NDArray[np.float32],
    guess: NDArray[np.float32] | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where N points are in image 1, and which are found: from a guess in the full image, else through the pyramid."""
    if not len(xy):
        return xy.reshape(0, 2), np.zeros(0, np.bool_)
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, tracker.iterations, tracker.accuracy)
    options: dict[str, Any] = {"winSize": (tracker.window, tracker.window), "criteria": stop}
    if guess is None:
        options |= {"maxLevel": tracker.max_level}
    else:
        options |= {"maxLevel": 0, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    start: Any = None if guess is None else guess.copy()  # OpenCV writes what it finds there
    reached, found, _ = cv2.calcOpticalFlowPyrLK(image0, image1, xy, start, **options)
    return np.asarray(reached, np.float32), found.ravel() > 0


def _within(xy: NDArray[np.float32], where: NDArray[np.float32], limit: float) -> NDArray[np.bool_]:
    dx, dy = (xy - where).T
    return np.asarray(dx * dx + dy * dy <= limit**2, np.bool_)


def _inside(tracker: KltTracker, image: GreyImage, xy: NDArray[np.float32]) -> NDArray[np.bool_]:
    (height, width), (x, y), low = image.shape, xy.T, tracker.margin
    return np.asarray((x >= low) & (x <= width - 1 - low) & (y >= low) & (y <= height - 1 - low), np.bool_)


def _of_all(
    count: int, alive: NDArray[np.int64], places: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Ends and survival of all points, from the numbers and places of those that are alive."""
    ends, survived = np.full((count, 2), np.nan, np.float32), np.zeros(count, np.bool_)
    ends[alive], survived[alive] = places, True
    return ends, survived

"""Disparity of single points of a rectified stereo pair, by matching patches along the row (epipolar matching)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.types import FloatArray, GreyImage

Floats = NDArray[np.float32]
_SAMPLES: Final = 5  # a patch is 5 x 5 samples ...
_SPACING: Final = 2  # ... two pixels apart, of a smoothed image: as telling as 9 x 9 pixels at a third of the work
_HALF: Final = _SPACING * (_SAMPLES - 1) // 2
_FINE_HALF: Final = 4  # sub-pixel refinement sees all 9 x 9 pixels, unsmoothed
_FINE_STEPS: Final = 3
_FLAT: Final = 1.0  # grey values: a patch that varies less has nothing to match
_NOISE: Final = 0.01  # no match is nearer to a perfect score than this: repeated texture is ambiguous
_NEAR_PEAK: Final = 2  # pixels of disparity that belong to the same peak
_CHUNK: Final = 256  # points at a time: their scores stay in the processor's cache


@dataclass(frozen=True, slots=True)
class StereoMatcher:
    """Finds points of one image in the other one of a rectified pair.

    Patches are compared by their normalised cross-correlation at every disparity from 0 to ``max_disparity`` pixels. A
    match holds if the score is at least ``min_score``; if it is unambiguous: its distance from a perfect score is at most
    ``max_ambiguity`` times that of the best score elsewhere; and if matching back returns within ``max_roundtrip`` pixels.
    Below ``min_disparity`` a disparity says nothing about depth.
    """

    max_disparity: int = 192
    min_disparity: float = 0.25
    min_score: float = 0.7
    max_ambiguity: float = 0.65
    max_roundtrip: float = 1.0

    @property
    def parameters(self) -> Mapping[str, Any]:
        """What a disparity depends on."""
        return {f.name: getattr(self, f.name) for f in fields(StereoMatcher)}

    def disparity(
        self, image: GreyImage, partner: GreyImage, xy: FloatArray, to_the_right: bool = True
    ) -> NDArray[np.float64]:
        """Disparity (N,) in pixels of N points (N, 2) of ``image`` (H, W); NaN where it is not known.

        With the partner's camera ``to_the_right`` a point at (x, y) is at (x - disparity, y) in ``partner`` (H, W), else at
        (x + disparity, y). Points nearer than 4 pixels to the left or right border are not known.
        """
        pictures = image.astype(np.float32), partner.astype(np.float32)
        smooth = cv2.blur(pictures[0], (3, 3)), cv2.blur(pictures[1], (3, 3))
        places = np.asarray(xy, np.float32).reshape(-1, 2)
        direction = -1 if to_the_right else 1
        chunks = (places[begin : begin + _CHUNK] for begin in range(0, len(places), _CHUNK))
        found = [self._disparity(pictures, smooth, chunk, direction) for chunk in chunks]
        return np.concatenate([np.zeros(0), *found])

    def _disparity(
        self, pictures: tuple[Any, Any], smooth: tuple[Any, Any], xy: Floats, direction: int
    ) -> NDArray[np.float64]:
        there, score, second = _best(_scores(smooth[0], smooth[1], xy, direction, self.max_disparity))
        distance = np.maximum(1 - score, _NOISE)
        at = np.flatnonzero((score >= self.min_score) & (distance <= self.max_ambiguity * (1 - second)))
        moved = xy[at] + np.outer(there[at], [direction, 0]).astype(np.float32)
        back, _, _ = _best(_scores(smooth[1], smooth[0], moved, -direction, self.max_disparity))
        at = at[np.abs(back - there[at]) <= self.max_roundtrip]
        fine = _refine(pictures[0], pictures[1], xy[at], there[at], direction)
        found = np.full(len(xy), np.nan)
        found[at] = np.where(fine >= self.min_disparity, fine, np.nan)
        return found


def _scores(image: Floats, partner: Floats, xy: Floats, direction: int, max_disparity: int) -> Floats:
    """Normalised cross-correlation (D, N) of N patches with those at disparities -1 ... max_disparity; -1 where none is.

    Disparity -1 is there so that 0 can be a peak. Columns run in ``direction``, so disparities always grow.
    """
    count, samples = max_disparity + 2, _SAMPLES**2
    rows = (np.arange(_SAMPLES, dtype=np.float32) - _SAMPLES // 2) * _SPACING
    patch = _sample(image, xy, rows, direction * rows)
    strip = _sample(partner, xy, rows, direction * np.arange(-1 - _HALF, max_disparity + _HALF + 1, dtype=np.float32))
    mean = patch.mean((0, 1))
    patch -= mean
    strip -= mean  # keeps the sums small; the correlation does not depend on it
    product, one = np.zeros((count, len(xy)), np.float32), np.empty((count, len(xy)), np.float32)
    total, squares = np.zeros_like(product), np.zeros_like(product)
    column_total, column_squares = strip.sum(0), np.square(strip).sum(0)
    for column in range(_SAMPLES):
        window = slice(column * _SPACING, column * _SPACING + count)
        total += column_total[window]
        squares += column_squares[window]
        for row in range(_SAMPLES):
            product += np.multiply(strip[row, window], patch[row, column], out=one)
    energy, own_energy = squares - total**2 / samples, np.square(patch).sum((0, 1))
    flat = samples * _FLAT**2
    scores = product / np.sqrt(np.maximum(energy, flat) * np.maximum(own_energy, flat))
    x = xy[:, 0] + direction * np.arange(-1, max_disparity + 1, dtype=np.float32)[:, None]
    seen = _has_columns(partner, x) & _has_columns(image, xy[:, 0])
    scores[~seen | (energy < flat) | (own_energy < flat)] = -1
    return np.asarray(scores, np.float32)


def _best(scores: Floats) -> tuple[NDArray[np.float64], Floats, Floats]:
    """Disparity (N,) of the highest score (D, N) with a parabola through it, that score, and the best one elsewhere."""
    each = np.arange(scores.shape[1])
    peak = scores.argmax(0)
    best = scores[peak, each]
    inner = np.clip(peak, 1, len(scores) - 2)
    before, middle, after = (scores[inner + step, each].astype(np.float64) for step in (-1, 0, 1))
    bend = before - 2 * middle + after
    peaked = (bend < 0) & (inner == peak) & (before > -1) & (after > -1)
    shift = np.where(peaked, 0.5 * (before - after) / np.where(peaked, bend, -1), 0)
    for step in range(-_NEAR_PEAK, _NEAR_PEAK + 1):
        scores[np.clip(peak + step, 0, len(scores) - 1), each] = -1
    return peak - 1 + shift, best, scores.max(0)


def _refine(
    image: Floats, partner: Floats, xy: Floats, disparity: NDArray[np.float64], direction: int
) -> NDArray[np.float64]:
    """Disparities (N,) that fit the patches best, by Gauss-Newton on the normalised patches (Lucas-Kanade along the row)."""
    offsets = np.arange(-_FINE_HALF, _FINE_HALF + 1, dtype=np.float32)
    goal, _ = _normalised(_sample(image, xy, offsets, offsets))
    refined = disparity.copy()
    for _ in range(_FINE_STEPS):
        moved = xy + np.outer(refined, [direction, 0]).astype(np.float32)
        wide = _sample(partner, moved, offsets, np.arange(-_FINE_HALF - 1, _FINE_HALF + 2, dtype=np.float32))
        current, norm = _normalised(wide[:, 1:-1])
        slope = (wide[:, 2:] - wide[:, :-2]) / 2
        slope = (slope - slope.mean((0, 1))) / norm
        slope -= current * (slope * current).sum((0, 1))  # what a change of contrast explains is no motion
        step = (slope * (goal - current)).sum((0, 1)) / np.maximum((slope**2).sum((0, 1)), 1e-9)
        refined += direction * np.clip(step, -0.5, 0.5)
    return np.where(np.abs(refined - disparity) <= 1, refined, disparity)  # what ran away had nothing to hold on to


def _normalised(patches: Floats) -> tuple[Floats, Floats]:
    """Patches (h, w, N) with zero mean and norm one, and their norms (N,)."""
    centred = patches - patches.mean((0, 1))
    norm = np.maximum(np.sqrt(np.square(centred).sum((0, 1))), 1e-6)
    return centred / norm, norm


def _sample(image: Floats, xy: Floats, rows: Floats, columns: Floats) -> Floats:
    """Patches (rows, columns, N) around N points, interpolated linearly; the border pixels go on outside."""
    shape = len(rows), len(columns), len(xy)
    if not len(xy):
        return np.zeros(shape, np.float32)
    x = np.broadcast_to(xy[:, 0] + columns[:, None], shape).reshape(-1, len(xy))
    y = np.broadcast_to(xy[:, 1] + rows[:, None, None], shape).reshape(-1, len(xy))
    taken = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(taken, np.float32).reshape(shape)


def _has_columns(image: Floats, x: Floats) -> NDArray[np.bool_]:
    """Whether a patch centred at column x lies inside the image; rows may go on outside, as they do so in both images."""
    inside: NDArray[np.bool_] = (x >= _HALF) & (x <= image.shape[1] - 1 - _HALF)
    return inside

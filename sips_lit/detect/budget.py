"""How many of an image's points are worth keeping: a fixed number, a threshold, or enough for k inliers."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sips_lit.detect.recalibration import AS_TRAINED, Recalibration
from sips_lit.detect.shared_effect import WEIGHTS, conditional_probabilities
from sips_lit.errors import BadInputError
from sips_lit.types import FloatArray, Keypoints


@dataclass(frozen=True, slots=True)
class Budget:
    """Keeps the best ``n`` points; with ``k`` as few as give k inliers with probability ``confidence``, at most ``n_max``.

    ``threshold`` drops points whose probability of being an inlier is lower, before anything else. The probability of k
    inliers takes the scores for what they are trained to be, and the points for independent, unless a recalibration
    knows better: its ``difficulty`` is what they share.

    Raises BadInputError for values out of range, and for more inliers than points.
    """

    n: int = 50
    threshold: float | None = None
    k: int | None = None
    confidence: float = 0.95
    n_max: int = 500

    def __post_init__(self) -> None:
        if self.n < 0:
            raise BadInputError(f"n is {self.n}: ask for a number of points that is not negative")
        if self.threshold is not None and not 0 <= self.threshold <= 1:
            raise BadInputError(f"threshold is {self.threshold:g}: it is a probability, give a number from 0 to 1")
        if self.k is not None and self.k < 1:
            raise BadInputError(f"k is {self.k}: ask for at least one inlier, or leave k out")
        if not 0 < self.confidence < 1:
            raise BadInputError(
                f"confidence is {self.confidence:g}: it is a probability, give a number between 0 and 1"
            )
        if self.n_max < 1:
            raise BadInputError(f"n_max is {self.n_max}: allow at least one point")
        if self.k is not None and self.k > self.n_max:
            raise BadInputError(
                f"k is {self.k} and n_max is {self.n_max}: n_max points can't hold k inliers, allow more or ask for fewer"
            )

    @property
    def candidates(self) -> int:
        """How many points of an image `keep` needs to see."""
        return self.n if self.k is None else self.n_max

    def keep(self, keypoints: Keypoints, recalibration: Recalibration = AS_TRAINED) -> tuple[Keypoints, bool]:
        """The points to keep of an image's `candidates` best ones, and whether they are enough for k inliers.

        Their scores are the probabilities that they have when no others are kept. Where even all of them are not enough,
        all are kept. Without ``k`` there is nothing to miss. ``recalibration``: that of the detector whose points they are.
        """
        keypoints = recalibration.best(keypoints, self.candidates)
        counts = np.arange(len(keypoints) + 1)
        if self.threshold is not None:
            # of the worst point, for each count
            last = recalibration.moved(keypoints.score, len(keypoints), counts[1:])
            counts = np.concatenate([counts[:1], counts[1:][last >= np.float32(self.threshold)]])
        keypoints = recalibration.best(keypoints, int(counts[-1]))
        if self.k is None:
            return keypoints, True
        needed = smallest_budget(keypoints.score, self.k, self.confidence, recalibration)
        if needed is None:
            return keypoints, False
        return recalibration.best(keypoints, int(counts[counts >= needed][0])), True

    def __str__(self) -> str:
        points = f"the best {self.n}"
        if self.k is not None:
            points = f"as few as give {self.k} inliers with probability {self.confidence:g}, at most {self.n_max}"
        return points if self.threshold is None else f"{points}, of those with P(inlier) >= {self.threshold:g}"


def smallest_budget(
    probability: FloatArray, k: int, confidence: float, recalibration: Recalibration = AS_TRAINED
) -> int | None:
    """The smallest n whose first n points hold at least ``k`` inliers with probability ``confidence``; None if none does.

    ``probability`` (N,): P(inlier) of each point, best first, when all N are kept.
    """
    points, difficulty = len(probability), recalibration.difficulty
    if recalibration.log_n == 0:
        # most images need few of their points, so only as many are looked at, then twice as many, and so on
        for seen in _doubling(2 * k, points):
            enough = enough_inliers_together(probability[:seen], k, difficulty) >= confidence
            if enough.any():
                return int(enough.argmax())
        return None

    def is_enough(n: int) -> bool:  # with n, as each point's probability does
        kept = recalibration.moved(np.asarray(probability[:n], np.float32), points, n)
        return bool(enough_inliers_together(kept, k, difficulty)[-1] >= confidence)

    too_few = 0
    for seen in _doubling(2 * k, points):
        if is_enough(seen):
            return bisect_left(range(seen), True, too_few, key=is_enough)
        too_few = seen
    return None


def _doubling(first: int, most: int) -> Iterator[int]:
    """``first``, twice that, ..., ``most``."""
    while first < most:
        yield first
        first *= 2
    yield most


def enough_inliers_together(probability: FloatArray, k: int, difficulty: float) -> NDArray[np.float64]:
    """`enough_inliers` of points that share an effect of this deviation on the logit, averaged over it, (N + 1,)."""
    if difficulty == 0:
        return enough_inliers(probability, k)
    averaged: NDArray[np.float64] = enough_inliers(conditional_probabilities(probability, difficulty), k) @ WEIGHTS
    return averaged


def enough_inliers(probability: FloatArray, k: int) -> NDArray[np.float64]:
    """P(at least ``k`` of the first n points are inliers), (N + 1, ...) for n = 0..N, of independent points (N, ...).

    The number of inliers is Poisson-binomial. The recursion over the points keeps P(exactly j), j < k, and adds up what
    leaves at j = k; it has no cancellation, so small probabilities stay exact. It takes O(N k) steps, one vector operation
    a point.
    """
    each = np.asarray(probability, np.float64)
    result = np.zeros((len(each) + 1, *each.shape[1:]))
    if k <= 0:
        return result + 1
    exactly = np.zeros((k, *each.shape[1:]))  # P(exactly j inliers so far)
    exactly[0] = 1
    for n, p in enumerate(each, start=1):
        result[n] = result[n - 1] + exactly[-1] * p
        up = exactly[:-1] * p
        exactly *= 1 - p
        exactly[1:] += up
    return result

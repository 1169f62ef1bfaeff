"""How many of an image's points are worth keeping: a fixed number, a threshold, or enough for k inliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.types import FloatArray, Keypoints


@dataclass(frozen=True, slots=True)
class Budget:
    """Keeps the best ``n`` points; with ``k`` as few as give k inliers with probability ``confidence``, at most ``n_max``.

    ``threshold`` drops points whose probability of being an inlier is lower, before anything else. The probability of k
    inliers takes the scores for what they are trained to be, and the points for independent.

    Raises BadInputError for values out of range.
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

    @property
    def candidates(self) -> int:
        """How many points of an image `keep` needs to see."""
        return self.n if self.k is None else self.n_max

    def keep(self, keypoints: Keypoints) -> tuple[Keypoints, bool]:
        """The points to keep of an image's `candidates` best ones, and whether they are enough for k inliers.

        Where even all of them are not enough, all are kept. Without ``k`` there is nothing to miss.
        """
        keypoints = keypoints.best(self.candidates)
        if self.threshold is not None:
            keypoints = keypoints.best(int(np.count_nonzero(keypoints.score >= np.float32(self.threshold))))
        if self.k is None:
            return keypoints, True
        needed = smallest_budget(keypoints.score, self.k, self.confidence)
        return (keypoints, False) if needed is None else (keypoints.best(needed), True)

    def __str__(self) -> str:
        points = f"the best {self.n}"
        if self.k is not None:
            points = f"as few as give {self.k} inliers with probability {self.confidence:g}, at most {self.n_max}"
        return points if self.threshold is None else f"{points}, of those with P(inlier) >= {self.threshold:g}"


def smallest_budget(probability: FloatArray, k: int, confidence: float) -> int | None:
    """The smallest n whose first n points hold at least ``k`` inliers with probability ``confidence``; None if none does.

    ``probability`` (N,): P(inlier) of each point, best first.
    """
    enough = enough_inliers(probability, k) >= confidence
    return int(enough.argmax()) if enough.any() else None


def enough_inliers(probability: FloatArray, k: int) -> NDArray[np.float64]:
    """P(at least ``k`` of the first n points are inliers), (N + 1,) for n = 0..N, of independent points (N,).

    The number of inliers is Poisson-binomial. The recursion over the points keeps P(exactly j), j < k, and adds up what
    leaves at j = k; it has no cancellation, so small probabilities stay exact. It takes O(N k) steps, one vector operation
    a point.
    """
    result = np.zeros(len(probability) + 1)
    if k <= 0:
        return result + 1
    exactly = np.zeros(k)  # P(exactly j inliers so far)
    exactly[0] = 1
    for n, p in enumerate(np.asarray(probability, np.float64).tolist(), start=1):
        result[n] = result[n - 1] + exactly[-1] * p
        up = exactly[:-1] * p
        exactly *= 1 - p
        exactly[1:] += up
    return result

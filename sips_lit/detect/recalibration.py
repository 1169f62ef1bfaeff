"""What turns a network's logits into probabilities that come true at the number of points that are kept."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.detect.shared_effect import logit, sigmoid
from sips_lit.types import Keypoints

REFERENCE_POINTS: Final = 50
"""The number of points at which ``log_n`` shifts nothing: that of score maps, where no points are kept."""
MOST_DIFFICULTY: Final = 4.0


@dataclass(frozen=True, slots=True)
class Recalibration:
    """P(inlier) = sigmoid(``scale`` * logit + ``offset`` + ``log_n`` * log(n / 50)), n points being kept in each image.

    It rises with the logit, so the order of the points stays, and with n, as a point finds its match among more.
    ``difficulty``: the standard deviation of what all points of one image of a pair share beyond that, on the logit (see
    `sips_lit.detect.shared_effect`); it changes no probability, but how likely so many of them come true together. The
    defaults take the network's logits for what they are, and points for independent.

    Platt (Advances in Large Margin Classifiers, 1999) has the scale and the offset.
    """

    scale: float = 1.0
    offset: float = 0.0
    log_n: float = 0.0
    difficulty: float = 0.0

    def __post_init__(self) -> None:
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        wrong = [f"{name} {value}" for name, value in values.items() if not math.isfinite(value)]
        if wrong or self.scale <= 0 or self.log_n < 0 or not 0 <= self.difficulty <= MOST_DIFFICULTY:
            raise ValueError(
                f"a recalibration needs a positive scale, a log_n that is not negative and a difficulty of 0 to "
                f"{MOST_DIFFICULTY:g}, all finite: it has {', '.join(f'{name} {v}' for name, v in values.items())}"
            )

    @property
    def config(self) -> dict[str, float]:
        """The constructor's arguments."""
        return asdict(self)

    def logits(self, logits: Any, n: int = REFERENCE_POINTS) -> Any:
        """Recalibrated ones, an array or tensor, with ``n`` points kept."""
        shift = self.offset + self.log_n * math.log(max(n, 1) / REFERENCE_POINTS)
        return self.scale * logits + shift

    def moved(self, score: NDArray[np.float32], n: int, kept: Any) -> NDArray[np.float32]:
        """Probabilities (N,) for ``kept`` points, a number or (N,), of those for ``n`` points."""
        if self.log_n == 0 or not len(score):
            return score
        shift = self.log_n * np.log(np.maximum(kept, 1) / max(n, 1))
        return sigmoid(logit(score) + shift).astype(np.float32)

    def best(self, keypoints: Keypoints, n: int) -> Keypoints:
        """The first ``n`` points with the probabilities that they have when the others are not kept.

        ``keypoints``: with those that they have when all are.
        """
        first = keypoints.best(n)
        score = self.moved(first.score, len(keypoints), len(first))
        return replace(first, score=score)


AS_TRAINED: Final = Recalibration()
"""Changes nothing."""

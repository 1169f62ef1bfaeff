"""Calibration: does a point that claims to be an inlier with probability p turn out as one with frequency p?

The paper's figure of probability against inlier frequency in 20 bins (Cieslewski et al., 3DV 2019), summarised by the
expected and the maximal calibration error (Guo et al., ICML 2017) and the Brier score.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from sips_lit.errors import BadInputError
from sips_lit.metrics.exact_sums import ExactSums

FloatVector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CalibrationResult:
    """Calibration in B bins.

    ``edges`` (B + 1,) of the bins; ``count`` (B,) points in each; ``mean_score`` and ``frequency`` (B,) their mean
    predicted probability and the fraction that are inliers, NaN in empty bins. ``ece`` is the mean of their difference
    over all points, ``mce`` the largest of any bin, ``brier`` the mean squared error of the single predictions. Without
    any points the three are NaN.
    """

    ece: float
    mce: float
    brier: float
    edges: FloatVector
    count: NDArray[np.int64]
    mean_score: FloatVector
    frequency: FloatVector

    @property
    def points(self) -> int:
        """How many points were counted."""
        return int(self.count.sum())

    @property
    def share(self) -> float:
        """Fraction of all points that are inliers."""
        return self._mean(self.frequency)

    @property
    def mean(self) -> float:
        """Mean predicted probability of all points."""
        return self._mean(self.mean_score)

    def _mean(self, of_bins: FloatVector) -> float:
        return float(np.nansum(of_bins * self.count) / self.points) if self.points else float("nan")


def bin_sums(scores: ArrayLike, labels: ArrayLike, bins: int = 20) -> NDArray[np.float64]:
    """Sums over N predicted probabilities and their truth (bool, or 0 and 1), both (N,), in each of B equal bins of [0, 1].

    (4, B): the number of points and the sums of score, label and squared error; those of two sets of points add. A bin
    holds its lower edge; the last holds 1.0 as well. Raises ValueError when the shapes differ, when a score is NaN or
    outside [0, 1], or a label is neither 0 nor 1.
    """
    score, label = np.asarray(scores, np.float64), np.asarray(labels, np.float64)
    if score.ndim != 1 or score.shape != label.shape:
        raise ValueError(f"scores and labels must both be (N,), not {score.shape} and {label.shape}")
    if not np.all((score >= 0) & (score <= 1)):
        raise ValueError("scores must be probabilities in [0, 1], without NaN")
    if not np.all((label == 0) | (label == 1)):
        raise ValueError("labels must be 0 or 1")
    edges = np.linspace(0, 1, bins + 1)
    index = np.minimum(np.searchsorted(edges, score, side="right") - 1, bins - 1)

    summed = (np.ones_like(score), score, label, (score - label) ** 2)
    return np.array([np.bincount(index, weights=values, minlength=bins) for values in summed], np.float64)


def summarise(sums: NDArray[np.float64]) -> CalibrationResult:
    """Calibration errors from the `bin_sums` (4, B)."""
    count, score, label, squared_error = sums
    bins, total = len(count), float(count.sum())
    filled = count > 0
    empty = np.full(bins, np.nan)
    mean_score = np.divide(score, count, out=empty.copy(), where=filled)
    frequency = np.divide(label, count, out=empty.copy(), where=filled)
    gap = np.abs(frequency - mean_score)[filled]
    nothing = float("nan")
    return CalibrationResult(
        ece=float(gap @ count[filled]) / total if total else nothing,
        mce=float(gap.max()) if total else nothing,
        brier=float(squared_error.sum()) / total if total else nothing,
        edges=np.linspace(0, 1, bins + 1),
        count=count.astype(np.int64),
        mean_score=mean_score,
        frequency=frequency,
    )


class Calibration(ExactSums[CalibrationResult]):
    """Calibration over the points given to `update`, merged exactly across processes (its state is sums per bin).

    ``compute`` gives the scalars that can be logged, ``ece``, ``mce`` and ``brier``, NaN without any points; ``result``
    gives the whole record.
    """

    units = 2**32  # so up to 2^31 points a bin
    scalars = ("ece", "mce", "brier")

    def __init__(self, bins: int = 20, **kwargs: Any) -> None:
        """Sort the scores into ``bins`` equal bins; ``kwargs`` go to `torchmetrics.Metric`.

        Raises BadInputError without bins.
        """
        if bins < 1:
            raise BadInputError(f"bins of the calibration is {bins}: give a whole number above 0")
        super().__init__(4, bins, **kwargs)
        self.bins = bins

    def update(self, scores: Tensor, labels: Tensor) -> None:
        """Add points: ``scores`` (N,) probabilities and ``labels`` (N,) bool or 0 and 1; raises as `bin_sums`."""
        self._add(bin_sums(scores.detach().float().cpu().numpy(), labels.detach().cpu().numpy(), self.bins))

    def summarised(self, sums: NDArray[np.float64]) -> CalibrationResult:
        """See `summarise`."""
        return summarise(sums)

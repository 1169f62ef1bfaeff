"""Reliability of covariances: are residuals as large as they are said to be?

If residuals are normal with the covariances that are claimed, the squared Mahalanobis distance is chi-squared with two
degrees of freedom, so 1 - exp(-d^2 / 2) is uniform in [0, 1]: of the residuals a share p lies within the ellipse of
probability p (Gneiting, Balabdaoui and Raftery, JRSS B 2007, for the transform; Kuleshov et al., ICML 2018, for the curve).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sips_lit.errors import BadInputError
from sips_lit.metrics.exact_sums import ExactSums

FloatVector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CovarianceReliability:
    """Of M residuals: the ``edges`` (B + 1,) of B equal bins of probability and the ``count`` (B,) in each.

    ``error``: mean, over the inner edges p, of the distance of the share of residuals within the ellipse of probability p
    from p; 0 at best, 1/2 at worst. ``scale``: the factor that covariances need, by maximum likelihood: half the mean
    squared Mahalanobis distance; above 1 they are too small. ``nll``: mean negative log of the density in nats, without
    log(2 pi). NaN without residuals.
    """

    error: float
    scale: float
    nll: float
    edges: FloatVector
    count: NDArray[np.int64]

    @property
    def residuals(self) -> int:
        """How many were counted."""
        return int(self.count.sum())

    @property
    def within(self) -> FloatVector:
        """The share of residuals (B + 1,) within the ellipse of each edge's probability."""
        return np.concatenate([[0.0], np.cumsum(self.count)]) / max(self.residuals, 1)


def squared_mahalanobis(residual: ArrayLike, covariance: ArrayLike) -> FloatVector:
    """Squared Mahalanobis distances (M,) of residuals (M, 2) under covariances (M, 2, 2)."""
    r, whole = np.asarray(residual, np.float64), np.asarray(covariance, np.float64)
    if not len(r):
        return np.zeros(0)
    distances: FloatVector = np.einsum("mi,mi->m", r, np.linalg.solve(whole, r[..., None])[..., 0])
    return distances


def reliability_sums(residual: ArrayLike, covariance: ArrayLike, bins: int = 20) -> NDArray[np.float64]:
    """Counts in B bins of 1 - exp(-d^2 / 2), then the sums of d^2 and of log-determinants: (B + 2,), which add.

    ``residual`` (M, 2) and ``covariance`` (M, 2, 2). Raises ValueError for other shapes, values that are not finite, and
    covariances that are not positive definite.
    """
    r, whole = np.asarray(residual, np.float64), np.asarray(covariance, np.float64)
    if r.ndim != 2 or r.shape[1] != 2 or whole.shape != (len(r), 2, 2):
        raise ValueError(f"residuals must be (M, 2) and covariances (M, 2, 2), not {r.shape} and {whole.shape}")
    determinant = whole[:, 0, 0] * whole[:, 1, 1] - whole[:, 0, 1] * whole[:, 1, 0]
    if not (
        np.isfinite(r).all() and np.isfinite(whole).all() and (determinant > 0).all() and (whole[:, 0, 0] > 0).all()
    ):
        raise ValueError("residuals and covariances must be finite, and covariances positive definite")
    squared = squared_mahalanobis(r, whole)
    index = np.minimum((-np.expm1(-squared / 2) * bins).astype(np.int64), bins - 1)
    counts = np.bincount(index, minlength=bins).astype(np.float64)
    return np.concatenate([counts, [squared.sum(), np.log(determinant).sum()]])


def summarise(sums: NDArray[np.float64]) -> CovarianceReliability:
    """Reliability from `reliability_sums` (B + 2,)."""
    count, squared, logs = sums[:-2].astype(np.int64), float(sums[-2]), float(sums[-1])
    edges, total = np.linspace(0, 1, len(count) + 1), int(count.sum())
    if not total:
        return CovarianceReliability(math.nan, math.nan, math.nan, edges, count)
    error = float(np.abs(np.cumsum(count)[:-1] / total - edges[1:-1]).mean()) if len(count) > 1 else 0.0
    return CovarianceReliability(error, squared / total / 2, (squared + logs) / total / 2, edges, count)


class CovarianceCalibration(ExactSums[CovarianceReliability]):
    """Reliability over the residuals given to `update`, merged exactly across processes (its state is sums).

    ``compute`` gives the scalars that can be logged, ``error``, ``scale`` and ``nll``, NaN without residuals; ``result``
    gives the whole record.
    """

    units = 2**20
    scalars = ("error", "scale", "nll")

    def __init__(self, bins: int = 20, **kwargs: Any) -> None:
        """Counts in ``bins`` equal bins of probability; ``kwargs`` go to `torchmetrics.Metric`.

        Raises BadInputError without bins.
        """
        if bins < 1:
            raise BadInputError(f"bins of the covariance is {bins}: give a whole number above 0")
        super().__init__(bins + 2, **kwargs)
        self.bins = bins

    def update(self, residual: ArrayLike, covariance: ArrayLike) -> None:
        """Add residuals (M, 2) with their covariances (M, 2, 2); raises as `reliability_sums`."""
        self._add(reliability_sums(residual, covariance, self.bins))

    def summarised(self, sums: NDArray[np.float64]) -> CovarianceReliability:
        """See `summarise`."""
        return summarise(sums)

"""Fits a recalibration to points whose truth is known.

First scale, offset and log_n, by maximum likelihood as if points were independent: logistic regression. That holds for the
means whatever the points share (Liang and Zeger, Biometrika 1986). Then difficulty, by the marginal likelihood of
`sips_lit.detect.shared_effect`, with the means as they are.

An image at one budget is a group. The same image at another budget, and the other image of the pair, are groups of their
own, and likelihoods multiply as if these were independent (a composite likelihood: Varin, Reid and Firth, Statistica Sinica
2011). It is the spread of inliers within one image at one budget that a budget needs to know: the matches of both images
are the same, so points of both in one group would pass each match's agreement with itself for difficulty.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.detect.recalibration import MOST_DIFFICULTY, REFERENCE_POINTS, Recalibration
from sips_lit.detect.shared_effect import Floats, conditional_logits, log_likelihood, sigmoid
from sips_lit.errors import BadInputError

_GOLDEN: Final = (math.sqrt(5) - 1) / 2
_TOLERANCE: Final = 0.01


@dataclass(frozen=True, slots=True)
class PointGroup:
    """Points (N,) of one image of a pair at a budget: the network's ``logit``, and whether each is an ``inlier``.

    ``n``: how many points were kept, those of unknown truth with them.
    """

    logit: Floats
    inlier: NDArray[np.bool_]
    n: int

    def probability(self, recalibration: Recalibration) -> Floats:
        """P(inlier) (N,)."""
        return sigmoid(recalibration.logits(self.logit, self.n))


def fit_recalibration(groups: Sequence[PointGroup]) -> Recalibration:
    """The recalibration under which the ``groups`` are most likely; every group weighs the same in its means.

    Of a single budget log_n stays 0, as it does where more points make inliers rarer. Raises BadInputError where all points
    are inliers or none is, and where better scores are not more often inliers.
    """
    groups = [group for group in groups if len(group.logit)]
    inliers, points = sum(int(group.inlier.sum()) for group in groups), sum(len(group.inlier) for group in groups)
    if not 0 < inliers < points:
        raise BadInputError(
            f"{inliers} of the {points} points to fit to are inliers: choose pairs of which some points are and some are not"
        )
    several = len({group.n for group in groups}) > 1
    means = _fit_means(groups, several)
    if means.log_n < 0:
        means = _fit_means(groups, False)
    if means.scale <= 0:
        raise BadInputError(
            "points with better scores are not more often inliers here, so no recalibration helps: check the data and its "
            "inliers, or train on such data"
        )
    recalibration = Recalibration(means.scale, means.offset, means.log_n)
    return replace(recalibration, difficulty=fit_difficulty(groups, recalibration))


@dataclass(frozen=True, slots=True)
class _Means:
    scale: float
    offset: float
    log_n: float


def _fit_means(groups: Sequence[PointGroup], several: bool) -> _Means:
    """Logistic regression by Newton's method, drawn to no change by a normal prior of deviation 1, for few points."""
    shift = [np.full(len(g.logit), math.log(max(g.n, 1) / REFERENCE_POINTS)) for g in groups]
    logit = np.concatenate([group.logit for group in groups])
    columns = [logit, np.ones_like(logit), *([np.concatenate(shift)] if several else [])]
    x, y = np.stack(columns, 1), np.concatenate([group.inlier for group in groups]).astype(np.float64)
    weight = np.concatenate([np.full(len(g.logit), 1 / len(g.logit)) for g in groups])
    weight /= weight.mean()
    start = np.array([1.0, 0.0, 0.0])[: x.shape[1]]

    def loss(beta: Floats) -> float:
        z = x @ beta
        return float(weight @ (np.logaddexp(0, z) - y * z) + 0.5 * ((beta - start) ** 2).sum())

    beta = start
    for _ in range(100):
        p = sigmoid(x @ beta)
        gradient = x.T @ (weight * (p - y)) + beta - start
        hessian = (x * (weight * p * (1 - p))[:, None]).T @ x + np.eye(len(beta))
        step, size = np.linalg.solve(hessian, gradient), 1.0
        while loss(beta - size * step) > loss(beta) and size > 1e-6:
            size /= 2
        beta = beta - size * step
        if np.abs(size * step).max() < 1e-9:
            break
    return _Means(float(beta[0]), float(beta[1]), float(beta[2]) if several else 0.0)


def fit_difficulty(groups: Sequence[PointGroup], recalibration: Recalibration) -> float:
    """The standard deviation, up to `MOST_DIFFICULTY`, under which the groups are most likely, by golden sections."""
    marginal = [np.asarray(recalibration.logits(group.logit, group.n), np.float64) for group in groups]
    together, ends = np.concatenate(marginal), np.cumsum([len(values) for values in marginal])[:-1]

    def likelihood(deviation: float) -> float:
        deltas = np.split(conditional_logits(together, deviation), ends)
        return sum(log_likelihood(d, group.inlier, deviation) for d, group in zip(deltas, groups, strict=True))

    low, high = 0.0, MOST_DIFFICULTY
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    of_left, of_right = likelihood(left), likelihood(right)
    while high - low > _TOLERANCE:
        if of_left >= of_right:
            high, right, of_right = right, left, of_left
            left = high - _GOLDEN * (high - low)
            of_left = likelihood(left)
        else:
            low, left, of_left = left, right, of_right
            right = low + _GOLDEN * (high - low)
            of_right = likelihood(right)
    middle = (low + high) / 2
    return middle if likelihood(middle) > likelihood(0.0) else 0.0

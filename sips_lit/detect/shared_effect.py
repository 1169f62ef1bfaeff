"""A normal effect on the logit that all points of an image of a pair share: some pairs are harder than they look.

Logistic regression with a random intercept (Stiratelli, Laird and Ware, Biometrics 1984), marginally specified (Heagerty,
Biometrics 1999): the mean over the effect is the probability that was predicted for a point, so that it stays calibrated
whatever the effect is. With the effect's standard deviation d, z standard normal:

    P(inlier | z) = sigmoid(delta + d z),    where delta solves    mean over z of sigmoid(delta + d z) = p.

Means over z are sums over equal steps. The nodes of Gauss and Hermite lie too far apart in the middle for the likelihood
of hundreds of points, which is narrower than they are; equal steps converge as fast for functions that vanish at both ends.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

NODES: Final[Floats] = np.linspace(-5, 5, 81)
"""(Q,) values of z."""
WEIGHTS: Final[Floats] = np.exp(-(NODES**2) / 2) / np.exp(-(NODES**2) / 2).sum()
"""(Q,) their probabilities."""
LARGEST_LOGIT: Final = 30.0
"""Beyond it a probability is 0 or 1 for all that is computed here."""
_STEPS: Final = 2001


def sigmoid(logits: Any) -> Floats:
    """Without overflow, and exact to the last digits of small probabilities, too."""
    values: Floats = np.exp(-np.logaddexp(0.0, -np.asarray(logits, np.float64)))
    return values


def logit(probability: Any) -> Floats:
    """Of probabilities, between plus and minus `LARGEST_LOGIT`."""
    p = np.asarray(probability, np.float64)
    with np.errstate(divide="ignore"):
        values: Floats = np.clip(np.log(p) - np.log1p(-p), -LARGEST_LOGIT, LARGEST_LOGIT)
    return values


def conditional_logits(marginal: Floats, deviation: float) -> Floats:
    """delta (N,) of the points whose probability, over all pairs, has the logits ``marginal`` (N,)."""
    if deviation == 0:
        return marginal
    return np.interp(marginal, *_marginal_of_conditional(deviation))


@lru_cache(maxsize=8)  # a detector asks with the same deviation for each image
def _marginal_of_conditional(deviation: float) -> tuple[Floats, Floats]:
    """Logits of the mean over z of sigmoid(delta + d z), and delta, both (_STEPS,), ascending."""
    bound = LARGEST_LOGIT * np.sqrt(1 + deviation**2) + deviation**2
    delta = np.linspace(-bound, bound, _STEPS)
    log_sigmoid = -np.logaddexp(0, -(delta[:, None] + deviation * NODES))
    means = np.logaddexp.reduce(log_sigmoid + np.log(WEIGHTS), axis=1)
    return means - means[::-1], delta  # the mean of 1 - sigmoid is that of sigmoid at the other end


def conditional_probabilities(probability: Any, deviation: float) -> Floats:
    """P(inlier | z) (N, Q) of points (N,) at the `NODES`; their mean by `WEIGHTS` is ``probability``."""
    target = logit(probability)
    delta = conditional_logits(target, deviation)
    given = sigmoid(delta[:, None] + deviation * NODES)
    if deviation == 0:
        return given
    mean, slope = given @ WEIGHTS, (given * (1 - given)) @ WEIGHTS
    known = (np.abs(target) < LARGEST_LOGIT / 2) & (slope > 0)
    step = np.where(
        known, (sigmoid(target) - mean) / np.where(known, slope, 1), 0
    )  # what interpolation left, by Newton
    return sigmoid((delta + step)[:, None] + deviation * NODES)


def log_likelihood(delta: Floats, inlier: NDArray[np.bool_], deviation: float) -> float:
    """Of the points (N,) of one image: log of the mean, over z, of the product of P(inlier or not | z)."""
    logits = delta[:, None] + deviation * NODES
    each = inlier @ logits - np.logaddexp(0, logits).sum(0)
    return float(np.logaddexp.reduce(each + np.log(WEIGHTS)))

"""Pairs whose points are inliers with a known probability, all of a pair easier or harder together, one draw at a time."""

import math

import numpy as np

from sips_lit.detect.fit_recalibration import PointGroup
from sips_lit.detect.recalibration import Recalibration


def conditional_by_bisection(probability: float, deviation: float) -> float:
    """delta with mean over z of sigmoid(delta + d z) = p, by halving and a fine sum: the slow twin."""
    z = np.linspace(-8, 8, 4001)
    weights = np.exp(-(z**2) / 2)
    weights /= weights.sum()
    low, high = -80.0, 80.0
    for _ in range(80):
        middle = (low + high) / 2
        mean = float(weights @ (1 / (1 + np.exp(-(middle + deviation * z)))))
        low, high = (middle, high) if mean < probability else (low, middle)
    return (low + high) / 2


def simulate(truth: Recalibration, pairs: int, budgets: tuple[int, ...], seed: int) -> list[PointGroup]:
    """A group for each budget of each pair; logits descend, the first the best."""
    generator = np.random.default_rng(seed)
    table = np.linspace(-12, 12, 241)
    delta = [conditional_by_bisection(1 / (1 + math.exp(-x)), truth.difficulty) for x in table]
    groups = []
    for _ in range(pairs):
        for n in budgets:
            logit = np.sort(generator.normal(0.5, 1.5, n))[::-1]
            marginal = truth.scale * logit + truth.offset + truth.log_n * math.log(n / 50)
            harder = truth.difficulty * generator.normal()
            p = 1 / (1 + np.exp(-(np.interp(marginal, table, delta) + harder)))
            groups.append(PointGroup(logit, generator.random(n) < p, n))
    return groups

"""Intervals by bootstrap: how much a number of a pair set would move with other pairs of the same kind.

The pairs are drawn anew with replacement, the number is computed of each draw, and the percentiles of these numbers are the
ends of the interval (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 13). The same draws serve all
methods, so that the differences between two of them are paired: what makes a pair hard for both cancels.

Pairs of one sequence look alike, and more of them tell less than their number says. From `FEWEST_GROUPS` sequences on whole
sequences are drawn, each with all its pairs (the cluster bootstrap: Davison and Hinkley, Bootstrap Methods and their
Application, 1997, section 3.8): the interval then speaks of other sequences of the kind. With fewer of them their
differences can't be seen, and pairs are drawn within each sequence: the interval then speaks of other pairs of these very
sequences, and is too narrow for others. The limit is our choice. A sequence with a single pair has no others to draw: those
that have but one are drawn together, as if they were one sequence (collapsed strata: Cochran, Sampling Techniques, 1977,
section 5A.12); else their numbers would look exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LEVEL: Final = 0.95
"""Of all intervals."""
FEWEST_GROUPS: Final = 10
"""Groups from which on whole groups are drawn."""


def draws_groups(groups: Sequence[str]) -> bool:
    """Whether whole groups are drawn, given the group of each pair; else pairs are drawn within each group."""
    return len(set(groups)) >= FEWEST_GROUPS


def draw_pairs(groups: Sequence[str], resamples: int, seed: int) -> IntArray:
    """How often each of P pairs is in each of B draws, (B, P), given the group (sequence) of each pair.

    Where `draws_groups`, as many groups as there are, and the size of a draw varies with theirs; else as many pairs of each
    group as it has, and as many groups of one pair as there are. The same arguments give the same draws.
    """
    generator = np.random.default_rng(seed)
    names, of_pair = np.unique(np.asarray(groups, str), return_inverse=True)
    if draws_groups(groups):
        even = np.full(len(names), 1 / len(names))
        return generator.multinomial(len(names), even, resamples)[:, of_pair]
    alone = np.bincount(of_pair)[of_pair] == 1
    of_pair = np.where(alone, len(names), of_pair)
    drawn = np.zeros((resamples, len(of_pair)), np.int64)
    for group in np.unique(of_pair):
        (members,) = np.nonzero(of_pair == group)
        drawn[:, members] = generator.multinomial(len(members), np.full(len(members), 1 / len(members)), resamples)
    return drawn


def resampled_mean(values: ArrayLike, drawn: IntArray) -> FloatArray:
    """The mean of what is known in each draw (B,), of ``values`` (P,) or, with repeats, (P, R); NaN is not known.

    A pair comes with all its repeats. NaN for a draw without a known value.
    """
    table = np.asarray(values, np.float64).reshape(drawn.shape[1], -1)
    known = ~np.isnan(table)
    sums = drawn @ np.where(known, table, 0).sum(1)
    count = drawn @ known.sum(1)
    means: FloatArray = np.divide(sums, count, out=np.full(len(drawn), np.nan), where=count > 0)
    return means


def resampled_curves(needed: ArrayLike, n_max: int, drawn: IntArray) -> FloatArray:
    """The succinctness curve s(n) of each draw, (B, n_max + 1), from n_k (P, R) of each pair and repeat, inf = failure."""
    table = np.minimum(np.asarray(needed, np.float64), n_max + 1).astype(np.int64).reshape(drawn.shape[1], -1)
    counts = np.zeros((len(table), n_max + 2))
    np.add.at(counts, (np.arange(len(table))[:, None], table), 1)
    summed = drawn @ counts
    curves: FloatArray = np.cumsum(summed[:, :-1], axis=1) / summed.sum(1, keepdims=True)
    return curves


def first_reached(curves: FloatArray, share: float) -> FloatArray:
    """The smallest n at which each curve (B, n_max + 1) is at least ``share``; (B,), infinite where it never is."""
    reached = curves >= share
    return np.where(reached.any(1), reached.argmax(1), np.inf)


def interval(samples: FloatArray, level: float = LEVEL) -> tuple[float, float]:
    """The percentile interval of numbers of draws (B,), those that are not NaN; NaN without any.

    An end is one of the numbers, the outer one of two neighbours, as the mean of a number and infinity is none.
    """
    known = samples[~np.isnan(samples)]
    if not known.size:
        return float("nan"), float("nan")
    tail = (1 - level) / 2
    low = np.quantile(known, tail, method="lower")
    return float(low), float(np.quantile(known, 1 - tail, method="higher"))


def difference(samples: FloatArray, others: FloatArray) -> FloatArray:
    """The paired difference (B,) between numbers of the same draws; 0 where both are infinite."""
    both = np.isinf(samples) & (samples == others)
    return np.subtract(samples, others, out=np.zeros_like(samples), where=~both)

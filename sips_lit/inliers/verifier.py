"""Inliers at any budget of a pair: from one verification of all matches, or from one of each budget.

The first is exact and for checks that verify a match whatever the other matches are (ground truth, KLT). The second is for
those that verify all matches together, by random samples (P3P): each is asked several times, with other samples and the
matches in another order, and n_k is found by the paper's binary search.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sips_lit.matching.mutual_nearest import MutualLifetimes
from sips_lit.types import Inliers, Matches, PreparedCheck


class VerifiedMatches(NamedTuple):
    """Matches at a budget, and which are inliers."""

    matches: Matches
    inliers: Inliers

    @property
    def inlier_count(self) -> int:
        """Number of inliers."""
        return int(self.inliers.inlier.sum())


def inliers_by_budget(lifetimes: MutualLifetimes, inlier: NDArray[np.bool_], n_max: int) -> NDArray[np.int64]:
    """inliers(n) for n = 0 … n_max, (n_max + 1,), from one verification of all matches that ever exist.

    ``inlier`` (M,) answers for each pair of ``lifetimes``. Right only where the answer for a match does not depend on
    the other matches (ground truth, KLT).
    """
    begin, end = lifetimes.first[inlier], lifetimes.last[inlier] + 1
    born = np.bincount(np.minimum(begin, n_max + 1), minlength=n_max + 2)
    died = np.bincount(np.minimum(end, n_max + 1), minlength=n_max + 2)
    return np.cumsum(born - died, dtype=np.int64)[: n_max + 1]


def points_needed(gained: NDArray[np.int64] | NDArray[np.float64], enough: float) -> int | None:
    """The smallest n with ``gained[n] >= enough``, None if there is none: n_k of the inliers(n) and k."""
    reached = np.flatnonzero(gained >= enough)
    return int(reached[0]) if len(reached) else None


def binary_search(count: Callable[[int], int], k: int, n_max: int) -> int | None:
    """n_k by the paper's binary search: ``count(n)`` inliers for about log2(n_max) budgets n in [k, n_max].

    It takes inliers to grow with n, which is false in general: a new point can break a match. So it finds *an* n with k
    inliers whose predecessor n - 1 lacked them, not always the smallest, and gives None whenever ``n_max`` itself lacks
    them. It halves [0, n_max] whatever k is, so that searches for different k ask for the same budgets. For verification
    that must be run for each set of matches (RANSAC).
    """
    if k > n_max or count(n_max) < k:
        return None
    return bisect_left(range(n_max), True, key=lambda n: n >= k and count(n) >= k)


@dataclass(frozen=True)
class ExactVerifier:
    """One verification of all matches that exist at any budget, ``lifetimes``, by a check that is independent."""

    lifetimes: MutualLifetimes
    inliers: Inliers
    n_max: int
    repeats: int = 1

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """inliers(n) for n = 0 … n_max."""
        return inliers_by_budget(self.lifetimes, self.inliers.inlier, self.n_max)

    def at(self, n: int, repeat: int) -> VerifiedMatches:
        """The matches of budget ``n`` and which are inliers."""
        alive = np.flatnonzero((self.lifetimes.first <= n) & (n <= self.lifetimes.last))
        matches = Matches(self.lifetimes.index0[alive], self.lifetimes.index1[alive])
        i = self.inliers
        residual = None if i.residual is None else i.residual[alive]
        known = i.known0[:n], i.known1[:n]
        return VerifiedMatches(matches, Inliers(i.inlier[alive], i.reason[alive], *known, residual))

    def needed(self, k: int, n_max: int, repeat: int) -> int | None:
        """n_k, or None if ``n_max`` points, at most those of the verifier, do not give ``k`` inliers."""
        return points_needed(self.counts[: n_max + 1], k)


@dataclass(frozen=True)
class SearchVerifier:
    """A verification for each budget that is asked for, by a ``check`` with other samples in each repeat.

    Each repeat sees the matches in another order, too. Answers are cached by their matches.
    """

    lifetimes: MutualLifetimes
    check: PreparedCheck
    repeats: int
    seed: int = 0
    _known: dict[tuple[int, bytes, bytes], VerifiedMatches] = field(default_factory=dict)

    def at(self, n: int, repeat: int) -> VerifiedMatches:
        """The matches of budget ``n`` and which are inliers."""
        ordered = self.lifetimes.at(n)
        key = (repeat, ordered.index0.tobytes(), ordered.index1.tobytes())
        if key not in self._known:
            order = np.random.default_rng([self.seed, repeat, 1]).permutation(len(ordered))
            matches = Matches(ordered.index0[order], ordered.index1[order])
            self._known[key] = VerifiedMatches(matches, self.check(matches, repeat))
        matches, i = self._known[key]
        return VerifiedMatches(matches, Inliers(i.inlier, i.reason, i.known0[:n], i.known1[:n], i.residual))

    def needed(self, k: int, n_max: int, repeat: int) -> int | None:
        """n_k by the paper's binary search, with all the caveats of `binary_search`, or None."""
        return binary_search(lambda n: self.at(n, repeat).inlier_count, k, n_max)


Verifier = ExactVerifier | SearchVerifier

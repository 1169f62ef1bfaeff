"""Inliers at any budget of a pair: from one verification of all matches, or from one of each budget.

The first is exact and for checks that verify a match whatever the other matches are (ground truth, KLT). The second is for
those that verify all matches together, by random samples (P3P): each is asked several times, with other samples and the
matches in another order, and n_k is found by the paper's binary search.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sips_lit.inliers.budgets import binary_search, inliers_by_budget, points_needed
from sips_lit.match.mutual_nearest import MutualLifetimes
from sips_lit.types import Inliers, Matches, PreparedCheck


class VerifiedMatches(NamedTuple):
    """Matches at a budget, and which are inliers."""

    matches: Matches
    inliers: Inliers

    @property
    def inlier_count(self) -> int:
        """Number of inliers."""
        return int(self.inliers.inlier.sum())


class Verifier(Protocol):
    """Verifies the matches between the ``n`` best points of both images of a pair, in each of ``repeats`` repeats."""

    @property
    def repeats(self) -> int:
        """How many answers there are to each question."""
        ...

    def at(self, n: int, repeat: int) -> VerifiedMatches:
        """The matches of budget ``n`` and which are inliers."""
        ...

    def needed(self, k: int, n_max: int, repeat: int) -> int | None:
        """n_k, or None if ``n_max`` points do not give ``k`` inliers."""
        ...


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
        """As `Verifier`."""
        alive = np.flatnonzero((self.lifetimes.first <= n) & (n <= self.lifetimes.last))
        matches = Matches(self.lifetimes.index0[alive], self.lifetimes.index1[alive])
        i = self.inliers
        return VerifiedMatches(matches, Inliers(i.inlier[alive], i.reason[alive], i.known0[:n], i.known1[:n]))

    def needed(self, k: int, n_max: int, repeat: int) -> int | None:
        """As `Verifier`; ``n_max`` at most that of the verifier."""
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
        """As `Verifier`."""
        ordered = self.lifetimes.at(n)
        key = (repeat, ordered.index0.tobytes(), ordered.index1.tobytes())
        if key not in self._known:
            order = np.random.default_rng([self.seed, repeat, 1]).permutation(len(ordered))
            matches = Matches(ordered.index0[order], ordered.index1[order])
            self._known[key] = VerifiedMatches(matches, self.check(matches, repeat))
        matches, i = self._known[key]
        return VerifiedMatches(matches, Inliers(i.inlier, i.reason, i.known0[:n], i.known1[:n]))

    def needed(self, k: int, n_max: int, repeat: int) -> int | None:
        """As `Verifier`, by the paper's binary search, with all the caveats of `binary_search`."""
        return binary_search(lambda n: self.at(n, repeat).inlier_count, k, n_max)

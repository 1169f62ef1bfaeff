"""The verified matches of a pair for every budget of points at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.match.mutual_nearest import MutualLifetimes, distances, mutual_nearest_lifetimes
from sips_lit.metrics.succinctness import binary_search, inliers_by_budget, points_needed
from sips_lit.types import Features, FramePair, InlierCheck, Inliers, Keypoints, Matches, PreparableCheck, PreparedCheck

Search = Literal["exact", "binary"]


@dataclass(frozen=True, slots=True)
class VerifiedPair:
    """A pair with its features, all matches that exist at some budget, and which of these are inliers."""

    pair: FramePair
    features0: Features
    features1: Features
    lifetimes: MutualLifetimes
    inliers: Inliers

    def inliers_by_budget(self, n_max: int) -> NDArray[np.int64]:
        """inliers(n) for n = 0 ... n_max, (n_max + 1,)."""
        return inliers_by_budget(self.lifetimes, self.inliers.inlier, n_max)

    def at(self, n: int) -> tuple[Matches, Inliers]:
        """The matches between the ``n`` best points of both images, and which are inliers."""
        alive = np.flatnonzero((self.lifetimes.first <= n) & (n <= self.lifetimes.last))
        matches = Matches(self.lifetimes.index0[alive], self.lifetimes.index1[alive])
        known0, known1 = self.inliers.known0[:n], self.inliers.known1[:n]
        return matches, Inliers(self.inliers.inlier[alive], self.inliers.reason[alive], known0, known1)


def verify(pair: FramePair, features0: Features, features1: Features, check: InlierCheck) -> VerifiedPair:
    """Matches of every budget, verified in one go.

    Raises BadInputError for an inlier check whose answer for a match depends on the other matches.
    """
    if not check.independent:
        raise BadInputError(
            f"inliers={check.protocol['inliers']} judges all matches of a budget together: use search=binary with it"
        )
    lifetimes = mutual_nearest_lifetimes(distances(features0, features1))
    return VerifiedPair(
        pair, features0, features1, lifetimes, check(pair, features0.keypoints, features1.keypoints, lifetimes.matches)
    )


def prepared(check: InlierCheck, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints) -> PreparedCheck:
    """The check of these points, for many sets of matches: what does not depend on the matches is done once if it can be."""
    if isinstance(check, PreparableCheck):
        return check.prepare(pair, keypoints0, keypoints1)
    return partial(check, pair, keypoints0, keypoints1)


def search_points_needed(
    pair: FramePair, features0: Features, features1: Features, check: InlierCheck, k: int, n_max: int, search: Search
) -> int | None:
    """n_k of a pair, or None: by the inliers at every budget, or by the paper's binary search."""
    if search == "exact":
        return points_needed(verify(pair, features0, features1, check).inliers_by_budget(n_max), k)
    lifetimes = mutual_nearest_lifetimes(distances(features0, features1))
    judge = prepared(check, pair, features0.keypoints, features1.keypoints)

    def count(n: int) -> int:
        return int(judge(lifetimes.at(n)).inlier.sum())

    return binary_search(count, k, n_max)

"""The verified matches of a pair at every budget of points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Literal, get_args

from sips_lit.errors import BadInputError
from sips_lit.inliers.verifier import ExactVerifier, SearchVerifier, Verifier
from sips_lit.match.mutual_nearest import distances, mutual_nearest_lifetimes
from sips_lit.types import Features, FramePair, InlierCheck, Inliers, Keypoints, Matches, PreparableCheck, PreparedCheck

Search = Literal["auto", "exact", "binary"]


@dataclass(frozen=True, slots=True)
class VerifiedPair:
    """A pair with its features, and what judges the matches between the best of them."""

    pair: FramePair
    features0: Features
    features1: Features
    judge: Verifier

    def at(self, n: int) -> tuple[Matches, Inliers]:
        """The matches between the ``n`` best points of both images, and which are inliers."""
        verified = self.judge.at(n, 0)
        return verified.matches, verified.inliers

    def points_needed(self, k: int, n_max: int) -> int | None:
        """n_k: the fewest points with ``k`` inliers, None if ``n_max`` are too few."""
        return self.judge.needed(k, n_max, 0)


def verify(
    pair: FramePair, features0: Features, features1: Features, check: InlierCheck, search: Search = "auto"
) -> VerifiedPair:
    """Matches of every budget with their verification.

    ``search``: exact, all budgets by one verification of all matches; binary, the paper's search by one verification of
    each budget that is asked for; auto, exact where the check allows it. Raises BadInputError for exact with a check whose
    answer for a match depends on the other matches.
    """
    if search not in get_args(Search):
        raise BadInputError(f"search is {search}: give {', '.join(get_args(Search))}")
    if search == "exact" and not check.independent:
        raise BadInputError(
            f"inliers={check.protocol['inliers']} judges all matches of a budget together: use search=binary with it"
        )
    lifetimes = mutual_nearest_lifetimes(distances(features0, features1))
    points = features0.keypoints, features1.keypoints
    judge: Verifier
    if check.independent and search != "binary":
        judge = ExactVerifier(lifetimes, check(pair, *points, lifetimes.matches), max(map(len, points)))
    else:
        answer = prepared(check, pair, *points)
        judge = SearchVerifier(lifetimes, lambda matches, repeat: answer(matches), repeats=1)
    return VerifiedPair(pair, features0, features1, judge)


def prepared(check: InlierCheck, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints) -> PreparedCheck:
    """The check of these points, for many sets of matches: what does not depend on the matches is done once if it can be."""
    if isinstance(check, PreparableCheck):
        return check.prepare(pair, keypoints0, keypoints1)
    return partial(check, pair, keypoints0, keypoints1)

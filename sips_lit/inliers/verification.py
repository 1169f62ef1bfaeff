"""The verified matches of a pair at every budget of points: what validation, evaluation and pictures start from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.inliers.point_labels import PointLabels, point_labels
from sips_lit.inliers.verifier import ExactVerifier, SearchVerifier, VerifiedMatches, Verifier
from sips_lit.matching.mutual_nearest import MutualLifetimes, distances, mutual_nearest_lifetimes
from sips_lit.types import Features, FramePair, InlierCheck, Keypoints

Search = Literal["auto", "exact", "binary"]


@dataclass(frozen=True, slots=True)
class VerifiedPair:
    """A pair with its features, and the verifier of the matches between the best of them."""

    pair: FramePair
    features0: Features
    features1: Features
    verifier: Verifier

    def at(self, n: int, repeat: int = 0) -> VerifiedMatches:
        """The matches between the ``n`` best points of both images, and which are inliers."""
        return self.verifier.at(n, repeat)

    def points_needed(self, k: int, n_max: int, repeat: int = 0, ordered: bool = True) -> int | None:
        """n_k: the fewest points with ``k`` inliers, None if ``n_max`` are too few.

        Points that are not ``ordered`` count all together: n_k is their number if all of them give k inliers.
        """
        if ordered:
            return self.verifier.needed(k, n_max, repeat)
        points = max(len(self.features0), len(self.features1))
        return points if self.at(points, repeat).inlier_count >= k else None

    def labels(self, n: int) -> tuple[PointLabels, PointLabels]:
        """The truth about the ``n`` best points of both images."""
        matches, inliers = self.at(n)
        return (
            point_labels(inliers, matches.index0, inliers.known0),
            point_labels(inliers, matches.index1, inliers.known1, 1),
        )

    def outcomes(
        self, n: int, best: Callable[[Keypoints, int], Keypoints] = Keypoints.best
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Score and truth (inlier or not) of the ``n`` best points of both images, where the truth is known.

        ``best`` gives them with the scores that they have when the others are not kept (see `Detector.best`).
        """
        labels = self.labels(n)
        score = np.concatenate([best(f.keypoints, n).score for f in (self.features0, self.features1)])
        known = np.concatenate([of_image.known for of_image in labels])
        return score[known], np.concatenate([of_image.inlier for of_image in labels])[known]

    def residuals(self, n: int) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
        """Residuals (R, 2) of the inlier matches between the ``n`` best points, forward and backward, where they are known.

        With the covariances (R, 2, 2) that the points claim: their sum, see `sips_lit.train.covariance_loss`. None where
        the check measures no residuals or the points have no covariances.
        """
        matches, inliers = self.at(n)
        claimed0, claimed1 = self.features0.keypoints.covariance, self.features1.keypoints.covariance
        if inliers.residual is None or claimed0 is None or claimed1 is None:
            return None
        residual = inliers.residual[inliers.inlier]
        claimed = (claimed0[matches.index0] + claimed1[matches.index1])[inliers.inlier]
        known = np.isfinite(residual).all(2)
        return residual[known], np.stack([claimed, claimed], 1)[known]


def verify(
    pair: FramePair,
    features0: Features,
    features1: Features,
    check: InlierCheck,
    search: Search = "auto",
    repeats: int = 1,
    seed: int = 0,
    lifetimes: MutualLifetimes | None = None,
) -> VerifiedPair:
    """Matches of every budget with their verification.

    ``search``: exact, all budgets by one verification of all matches; binary, the paper's search by one verification of
    each budget that is asked for; auto, exact where the check allows it. A check whose answer for a match depends on the
    other matches is asked in ``repeats`` repeats, with the matches in orders drawn by ``seed``. ``lifetimes``: the matches,
    if they are known. Raises BadInputError for exact with such a check, and for a pair that the check cannot verify.
    """
    if search not in get_args(Search):
        raise BadInputError(f"search is {search}: give {', '.join(get_args(Search))}")
    if search == "exact" and not check.independent:
        raise BadInputError(
            f"inliers={check.protocol['inliers']} verifies all matches of a budget together: use search=binary with it"
        )
    if lifetimes is None:
        lifetimes = mutual_nearest_lifetimes(distances(features0, features1))
    prepared = check.prepare(pair, features0.keypoints, features1.keypoints)
    verifier: Verifier
    if check.independent and search != "binary":
        verifier = ExactVerifier(lifetimes, prepared(lifetimes.matches), max(len(features0), len(features1)))
    else:
        verifier = SearchVerifier(lifetimes, prepared, 1 if check.independent else repeats, seed)
    return VerifiedPair(pair, features0, features1, verifier)


def judged_points(verified: VerifiedPair, check: InlierCheck, n: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which of the ``n`` best points of both images are known, by themselves or by a match at any budget up to n."""
    at_n = verified.at(n).inliers
    if at_n.known0.all() and at_n.known1.all():
        return at_n.known0, at_n.known1
    best0, best1 = (features.keypoints.best(n) for features in (verified.features0, verified.features1))
    lifetimes = verified.verifier.lifetimes
    inliers = check.prepare(verified.pair, best0, best1)(lifetimes[lifetimes.first <= n].matches)
    return inliers.known0, inliers.known1


def verify_judged(
    verified: VerifiedPair, check: InlierCheck, n: int, search: Search = "auto", repeats: int = 1, seed: int = 0
) -> VerifiedPair:
    """The pair with the `judged_points` of the ``n`` best alone, matched and verified anew; as it is if all are known.

    ``check``, ``search``, ``repeats`` and ``seed``: those of `verify`, which raises what this raises.
    """
    known0, known1 = judged_points(verified, check, n)
    if known0.all() and known1.all():
        return verified
    judged0, judged1 = verified.features0.best(n)[known0], verified.features1.best(n)[known1]
    return verify(verified.pair, judged0, judged1, check, search, repeats, seed)

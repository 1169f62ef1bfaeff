"""Every number of a pair, counted by hand."""

import math

import numpy as np
import pytest
from textured_scenes import keypoints

from sips_lit.evaluate.measure import PoseErrors, measure
from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.result import PoseOutcome
from sips_lit.inliers.verification import VerifiedPair
from sips_lit.inliers.verifier import VerifiedMatches
from sips_lit.types import Features, FramePair, Inliers, Matches, Reason

IMAGE = np.zeros((80, 160), np.uint8)  # cells of the 8 x 8 grid are 20 x 10 pixels
SHIFT = np.array([[1.0, 0, 10], [0, 1, 0], [0, 0, 1]])
PAIR = FramePair("p", 0, 1, (IMAGE, IMAGE), IMAGE, IMAGE, SHIFT)


def features(xy, score=None) -> Features:
    points = keypoints(xy, score)
    return Features(points, np.zeros((len(points), 1), np.float32), "l2")


# image 1 shows everything 10 px further right; its third point is 5 px off, the last has nothing in image 0
POINTS0 = features([[5, 5], [45, 5], [45, 25], [155, 75]], [0.9, 0.8, 0.6, 0.1])
POINTS1 = features([[15, 5], [55, 6], [60, 25], [100, 70]], [0.9, 0.7, 0.5, 0.2])


class Known:
    """The best n points of both images are matched in order; the first two matches are inliers."""

    repeats = 2

    def __init__(self, needed) -> None:
        self.answers = needed

    def at(self, n, repeat):
        index = np.arange(min(n, 4))
        reason = np.where(index < 2 - repeat, Reason.INLIER, Reason.FAR).astype(np.uint8)
        known = np.ones(4, bool)[:n]
        return VerifiedMatches(Matches(index, index), Inliers(reason == Reason.INLIER, reason, known, known))

    def needed(self, k, n_max, repeat):
        return self.answers.get((k, repeat))


class Pose:
    """The error is the number of matches."""

    def errors(self, matches, repeat, least=0):
        if least > 2:
            return PoseErrors(math.inf, math.inf, PoseOutcome.FEW_INLIERS)
        return PoseErrors(float(len(matches)), 10.0 * len(matches) + repeat, PoseOutcome.FOUND)


def of(verifier, pose=None, scores="order", pair=PAIR, **options):
    m = Measures(k=1, ks=(2,), n_max=10, n=3, budgets=(4,), repeats=2, calibration=(2, 4), pose_inliers=2, **options)
    return measure(VerifiedPair(pair, POINTS0, POINTS1, verifier), pose, m, scores)


VERIFIER = Known({(1, 0): 1, (2, 0): 3, (1, 1): 2})


def test_points_needed():
    np.testing.assert_array_equal(of(VERIFIER).n_k, [[1, 3], [2, math.inf]])


def test_judged_points():
    """Half of the points of image 0 and three quarters of those of image 1 are; what needs the others is as ever."""
    m = Measures(k=1, ks=(2,), n_max=10, n=3, budgets=(4,), repeats=2)
    judged = VerifiedPair(PAIR, POINTS0.best(2), POINTS1.best(3), Known({(1, 0): 1, (2, 0): 2, (1, 1): 2, (2, 1): 3}))
    measured = measure(VerifiedPair(PAIR, POINTS0, POINTS1, VERIFIER), Pose(), m, judged=judged)
    np.testing.assert_array_equal(measured.n_k_judged, [[1, 2], [2, 3]])
    assert measured.unknown == 3 / 8
    all_judged = measure(VerifiedPair(PAIR, POINTS0, POINTS1, VERIFIER), Pose(), m)
    np.testing.assert_array_equal(all_judged.n_k_judged, all_judged.n_k)
    assert all_judged.unknown == 0
    np.testing.assert_array_equal(measured.n_k, all_judged.n_k)
    np.testing.assert_array_equal(measured.rotation_error, all_judged.rotation_error)
    for n in (3, 4):
        assert measured.budgets[n].inliers.tolist() == all_judged.budgets[n].inliers.tolist()
    # of the two best of each image, two and two are judged
    few = measure(VerifiedPair(PAIR, POINTS0, POINTS1, VERIFIER), None, Measures(k=1, n=2, n_max=2), judged=judged)
    assert few.unknown == 0


def test_points_without_scores_are_all_or_nothing():
    m = Measures(k=1, ks=(2, 3), n_max=10, n=3, budgets=(4, 7), repeats=2)
    measured = measure(VerifiedPair(PAIR, POINTS0, POINTS1, VERIFIER), None, m, "none")
    np.testing.assert_array_equal(measured.n_k, [[4, 4, math.inf], [4, math.inf, math.inf]])
    assert set(measured.budgets) == {4, 7}  # which three of the four points are the best nobody knows


def test_poses_at_n_k():
    measured = of(VERIFIER, Pose())
    np.testing.assert_array_equal(measured.rotation_error, [[1, 3], [2, math.inf]])
    np.testing.assert_array_equal(measured.translation_error, [[10, 30], [21, math.inf]])
    nobody_knows = of(VERIFIER, None)
    assert np.isnan(nobody_knows.rotation_error).all()
    assert np.isnan(nobody_knows.budgets[3].translation_error).all()
    assert nobody_knows.budgets[3].outcome.tolist() == [PoseOutcome.UNKNOWN] * 2


def test_at_a_budget():
    at = of(VERIFIER, Pose()).budgets[4]
    assert at.matches == 4
    assert at.inliers.tolist() == [2, 1]
    assert at.rotation_error.tolist() == [4, 4]
    assert at.translation_error.tolist() == [40, 41]
    # (155, 75) leaves the view: three points of image 0 against four of image 1; two are found again and matched
    assert at.repeatability == at.matching_score == pytest.approx(2 / 3)
    # inliers at (5, 5) and (45, 5): cells 0 and 2 of the first row
    assert at.spread == 2 / 64
    assert of(VERIFIER, Pose(), cells=2).budgets[4].spread == 1 / 4
    assert of(VERIFIER, Pose(), threshold=5.0).budgets[4].matching_score == 1


def test_a_pose_needs_inliers_at_a_budget():
    m = Measures(k=1, ks=(), n_max=10, n=4, repeats=2, pose_inliers=3)
    measured = measure(VerifiedPair(PAIR, POINTS0, POINTS1, VERIFIER), Pose(), m)
    assert np.isinf(measured.budgets[4].rotation_error).all()
    assert measured.budgets[4].outcome.tolist() == [PoseOutcome.FEW_INLIERS] * 2
    np.testing.assert_array_equal(measured.rotation_error, [[1], [2]])


def test_without_truth_nothing_can_be_repeated():
    pair = FramePair("p", 0, 1, (IMAGE, IMAGE), IMAGE, IMAGE)
    repeated = of(VERIFIER, pair=pair).budgets[4]
    assert math.isnan(repeated.repeatability)
    assert math.isnan(repeated.matching_score)


def test_outcomes_of_probabilities():
    assert not of(VERIFIER).outcomes
    outcomes = of(VERIFIER, scores="probability").outcomes
    scores, inlier = outcomes[4]
    np.testing.assert_allclose(scores, [0.9, 0.8, 0.6, 0.1, 0.9, 0.7, 0.5, 0.2])
    assert inlier.tolist() == [True, True, False, False] * 2
    assert outcomes[2][1].tolist() == [True] * 4


def test_found_again_but_not_matched():
    """Two of the three points that image 1 sees are found again; one of these is matched."""

    class One(Known):
        def at(self, n, repeat):
            index, known = np.zeros(1, int), np.ones(4, bool)
            return VerifiedMatches(
                Matches(index, index), Inliers(np.ones(1, bool), np.zeros(1, np.uint8), known, known)
            )

    at = of(One({})).budgets[4]
    assert (at.repeatability, at.matching_score) == (pytest.approx(2 / 3), pytest.approx(1 / 3))


def test_spread_is_that_of_image_0():
    near, far = features([[5, 5], [8, 5]]), features([[5, 5], [25, 5]])
    m = Measures(k=1, ks=(), n_max=10, n=2, repeats=2)
    assert measure(VerifiedPair(PAIR, far, near, VERIFIER), None, m).budgets[2].spread == 2 / 64
    assert measure(VerifiedPair(PAIR, near, far, VERIFIER), None, m).budgets[2].spread == 1 / 64

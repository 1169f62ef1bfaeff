import dataclasses

import numpy as np
import pytest
from textured_scenes import keypoints

from sips_lit.errors import BadInputError
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.independent import IndependentCheck
from sips_lit.inliers.point_labels import symmetric
from sips_lit.inliers.verification import judged_points, verify, verify_judged
from sips_lit.matching.mutual_nearest import distances, mutual_nearest
from sips_lit.types import Features, FramePair, Matches, Reason

IMAGE = np.zeros((120, 160), np.uint8)
PAIR = FramePair("wall:0-1", 0, 1, (IMAGE, IMAGE), IMAGE, IMAGE, np.array([[1, 0, 4], [0, 1, -3], [0, 0, 1.0]]))


def features(n0: int, n1: int, seed: int) -> tuple[Features, Features]:
    """Points of which many, but not all, correspond, with descriptors that often confuse them."""
    generator = np.random.default_rng(seed)
    xy0 = generator.uniform(10, 100, (n0, 2))
    xy1 = generator.uniform(10, 100, (n1, 2))
    d0, d1 = generator.normal(size=(n0, 3)), generator.normal(size=(n1, 3))
    common = generator.permutation(min(n0, n1))[: int(0.7 * min(n0, n1))]
    place = generator.permutation(n1)[: len(common)]
    xy1[place] = xy0[common] + [4, -3] + generator.normal(size=(len(common), 2))
    d1[place] = d0[common] + 0.4 * generator.normal(size=(len(common), 3))
    return (
        Features(keypoints(xy0), d0.astype(np.float32).round(1), "l2"),
        Features(keypoints(xy1), d1.astype(np.float32).round(1), "l2"),
    )


def cropped(features0: Features, features1: Features, n: int) -> tuple[set[tuple[int, int]], set[tuple[int, int]]]:
    """Matches and inliers of the n best points, matched anew."""
    best0, best1 = features0.best(n), features1.best(n)
    matches = mutual_nearest(distances(best0, best1))
    inlier = HomographyInliers()(PAIR, best0.keypoints, best1.keypoints, matches).inlier
    pairs = list(zip(matches.index0.tolist(), matches.index1.tolist(), strict=True))
    return set(pairs), {pair for pair, good in zip(pairs, inlier, strict=True) if good}


SIZES = [(40, 40), (25, 40), (40, 12), (1, 1), (0, 5), (0, 0)]


@pytest.mark.parametrize(("n0", "n1"), SIZES)
@pytest.mark.parametrize("seed", range(3))
def test_every_budget_as_if_cropped_matched_and_checked_anew(n0, n1, seed):
    features0, features1 = features(n0, n1, seed)
    verified = verify(PAIR, features0, features1, HomographyInliers())
    for n in range(51):
        expected, expected_inliers = cropped(features0, features1, n)
        matches, inliers = verified.at(n)
        pairs = list(zip(matches.index0.tolist(), matches.index1.tolist(), strict=True))
        assert set(pairs) == expected
        assert len(pairs) == len(expected)
        assert {pair for pair, good in zip(pairs, inliers.inlier, strict=True) if good} == expected_inliers
        np.testing.assert_array_equal(inliers.inlier, inliers.reason == Reason.INLIER)
        assert (len(inliers.known0), len(inliers.known1)) == (min(n, n0), min(n, n1))


def test_a_budget_can_lose_inliers_here():
    pairs = [verify(PAIR, *features(40, 40, seed), HomographyInliers()) for seed in range(3)]
    counts = [[pair.at(n)[1].inlier.sum() for n in range(41)] for pair in pairs]
    assert any((np.diff(c) < 0).any() for c in counts)  # so the comparison above covers matches that break
    assert all(c[40] > 5 for c in counts)


@pytest.mark.parametrize("k", [1, 5, 10, 25])
@pytest.mark.parametrize("seed", range(3))
def test_exact_search_finds_the_smallest_budget(k, seed):
    both = features(40, 40, seed)
    enough = [n for n in range(51) if len(cropped(*both, n)[1]) >= k]
    found = verify(PAIR, *both, HomographyInliers(), "exact").points_needed(k, 50)
    assert found == (min(enough) if enough else None)


class Dependent(IndependentCheck):
    """Calls nothing an inlier unless five matches agree, like an estimated pose."""

    independent, protocol = False, {"inliers": "five"}

    def __init__(self) -> None:
        self.asked: list[Matches] = []

    def __call__(self, pair, keypoints0, keypoints1, matches):
        self.asked.append(matches)
        answer = HomographyInliers()(pair, keypoints0, keypoints1, matches)
        if answer.inlier.sum() < 5:
            answer.inlier[:] = False
        return answer


def test_a_check_that_needs_all_matches_can_be_searched_by_halving_only():
    both = features(40, 40, 0)
    with pytest.raises(BadInputError, match=r"inliers=five verifies all matches .* use search=binary"):
        verify(PAIR, *both, Dependent(), "exact")
    verified = verify(PAIR, *both, Dependent())
    assert verified.points_needed(5, 40) == verify(PAIR, *both, Dependent(), "binary").points_needed(5, 40)
    assert verified.at(30)[1].inlier.sum() == len(cropped(*both, 30)[1])


def test_an_unknown_search():
    with pytest.raises(BadInputError, match="search is guess"):
        verify(PAIR, *features(5, 5, 0), HomographyInliers(), "guess")


@pytest.mark.parametrize("k", [2, 5, 6])
@pytest.mark.parametrize("seed", range(3))
def test_search_by_halving_ends_where_enough_begins(k, seed):
    both, check = features(40, 40, seed), Dependent()
    found = verify(PAIR, *both, check, "binary").points_needed(k, 40)
    assert found is not None
    assert len(cropped(*both, found)[1]) >= max(k, 5)
    assert found == k or len(cropped(*both, found - 1)[1]) < max(k, 5)
    assert len(check.asked) <= 8  # 1 + log2(40)
    for matches in check.asked:  # each time the matches of that budget, not those of another
        pairs = set(zip(matches.index0.tolist(), matches.index1.tolist(), strict=True))
        assert any(pairs == cropped(*both, n)[0] for n in range(41))


def test_too_few_inliers_at_all():
    both = features(40, 40, 0)
    assert verify(PAIR, *both, HomographyInliers(), "exact").points_needed(41, 60) is None
    assert verify(PAIR, *both, HomographyInliers(), "binary").points_needed(41, 60) is None


@pytest.mark.parametrize(("n0", "n1"), SIZES)
def test_points_without_an_order_count_all_together(n0, n1):
    both = features(n0, n1, 0)
    verified, inliers = verify(PAIR, *both, HomographyInliers()), len(cropped(*both, 40)[1])
    for k in (1, inliers, inliers + 1):
        expected = max(n0, n1) if inliers >= k else None
        assert verified.points_needed(k, 50, ordered=False) == expected


def test_outcomes_are_scores_and_labels_of_the_best_points():
    both = features(25, 40, 1)
    scores, inlier = verify(PAIR, *both, HomographyInliers()).outcomes(20)
    np.testing.assert_array_equal(scores, np.concatenate([f.keypoints.score[:20] for f in both]))
    found = cropped(*both, 20)[1]
    expected = [i in {a for a, _ in found} for i in range(20)] + [j in {b for _, b in found} for j in range(20)]
    assert inlier.tolist() == expected
    assert 0 < sum(expected) < 40


class HalfKnown(IndependentCheck):
    """Knows the points of even index only, and of matches those between two of them."""

    protocol = HomographyInliers().protocol

    def __call__(self, pair, keypoints0, keypoints1, matches):
        found = HomographyInliers()(pair, keypoints0, keypoints1, matches)
        known0, known1 = np.arange(len(keypoints0)) % 2 == 0, np.arange(len(keypoints1)) % 2 == 0
        unknown = ~(known0[matches.index0] & known1[matches.index1])
        found.reason[unknown], found.inlier[unknown] = Reason.UNKNOWN, False
        return dataclasses.replace(found, known0=known0, known1=known1)


def test_points_whose_truth_is_unknown_have_no_outcome():
    both = features(40, 40, 1)
    verified = verify(PAIR, *both, HalfKnown())
    matches, inliers = verified.at(40)
    index = np.arange(40)
    matched_to_nobody_known = [set(side[inliers.reason == Reason.UNKNOWN]) for side in (matches.index0, matches.index1)]
    expected = [
        f.keypoints.score[i]
        for f, unknown in zip(both, matched_to_nobody_known, strict=True)
        for i in index
        if i % 2 == 0 and i not in unknown
    ]
    scores, inlier = verified.outcomes(40)
    np.testing.assert_array_equal(scores, np.array(expected, np.float32))
    assert 0 < len(scores) == len(inlier) < 40


def test_all_matches_are_verified_at_once_where_that_is_possible():
    both, calls = features(40, 40, 0), []

    class Counted(HomographyInliers):
        def __call__(self, *arguments):
            calls.append(1)
            return super().__call__(*arguments)

    verified = verify(PAIR, *both, Counted())
    assert [verified.points_needed(k, 40) for k in (2, 5, 9)]
    assert [len(verified.at(n).matches) for n in (5, 10, 20)]
    assert len(calls) == 1


class Patchy(IndependentCheck):
    """Knows the depth of the points of some places; a match is judged if it does of one of its points."""

    protocol = HomographyInliers().protocol

    def __init__(self, share: float, independent: bool = True, share1: float | None = None) -> None:
        self.shares, self.independent, self.calls = (share, share if share1 is None else share1), independent, 0

    def __call__(self, pair, keypoints0, keypoints1, matches):
        self.calls += 1
        reason = HomographyInliers()(pair, keypoints0, keypoints1, matches).reason
        both = zip((keypoints0, keypoints1), self.shares, strict=True)
        has0, has1 = (np.sin(1e3 * k.xy[:, 0]) ** 2 < share for k, share in both)
        forward = np.where(has0[matches.index0], reason, Reason.UNKNOWN).astype(np.uint8)
        backward = np.where(has1[matches.index1], reason, Reason.UNKNOWN).astype(np.uint8)
        return symmetric(forward, backward, matches, has0, has1)


def checked(best0: Features, best1: Features, check: Patchy):
    matches = mutual_nearest(distances(best0, best1))
    return check(PAIR, best0.keypoints, best1.keypoints, matches)


def known_one_by_one(both: tuple[Features, Features], check: Patchy, n: int) -> list[list[int]]:
    """The points of each image that the check knows at any budget up to n, cropped, matched and checked anew."""
    known: list[set[int]] = [set(), set()]
    for budget in range(n + 1):
        inliers = checked(*(f.best(budget) for f in both), check)
        known[0].update(np.flatnonzero(inliers.known0).tolist())
        known[1].update(np.flatnonzero(inliers.known1).tolist())
    return [sorted(points) for points in known]


def inliers_among(both: tuple[Features, Features], known: list[list[int]], check: Patchy, n: int) -> int:
    """Of the n best of the known points, which alone are matched."""
    rest = [
        Features(keypoints(f.keypoints.xy[k[:n]], f.keypoints.score[k[:n]]), f.descriptors[k[:n]], "l2")
        for f, k in zip(both, known, strict=True)
    ]
    return int(checked(*rest, check).inlier.sum())


@pytest.mark.parametrize(("n0", "n1"), SIZES)
@pytest.mark.parametrize("share", [0.2, 0.6])
@pytest.mark.parametrize("n_max", [30, 50])  # fewer than there are points, and more
def test_judged_points_as_if_there_were_no_others(n0, n1, share, n_max):
    both, check = features(n0, n1, 2), Patchy(share)
    verified = verify(PAIR, *both, check)
    known = known_one_by_one(both, check, n_max)
    assert [np.flatnonzero(side).tolist() for side in judged_points(verified, check, n_max)] == known
    counts = [inliers_among(both, known, check, n) for n in range(n_max + 1)]
    judged = verify_judged(verified, check, n_max)
    for k in range(1, 16):
        expected = next((n for n, count in enumerate(counts) if count >= k), None)
        assert judged.points_needed(k, n_max) == expected
        together = max(map(len, known)) if counts[-1] >= k else None
        assert judged.points_needed(k, n_max, ordered=False) == together
    if n0 == n1 == 40:
        assert counts[-1] > 1
        assert all(0 < len(points) < min(n_max, 40) for points in known)


def test_points_are_judged_through_their_matches():
    """Those of the examples above: some have no depth of their own."""
    both, check = features(40, 40, 2), Patchy(0.2)
    alone = check(PAIR, both[0].keypoints, both[1].keypoints, Matches(*np.zeros((2, 0), np.int64)))
    known0, known1 = judged_points(verify(PAIR, *both, check), check, 40)
    assert (known0 >= alone.known0).all()
    assert known0.sum() > alone.known0.sum()
    assert known1.sum() > alone.known1.sum()


@pytest.mark.parametrize("shares", [(1.1, -1), (-1, 1.1)])
def test_depth_of_one_image_alone_judges_the_matched_points_of_the_other(shares):
    both, check = features(40, 40, 2), Patchy(shares[0], share1=shares[1])
    known = known_one_by_one(both, check, 40)
    assert sorted(map(len, known))[1] == 40 > min(map(len, known)) > 10
    judged = verify_judged(verify(PAIR, *both, check), check, 40)
    counts = [inliers_among(both, known, check, n) for n in range(41)]
    for k in (1, 5, 10):
        assert judged.points_needed(k, 40) == next((n for n, count in enumerate(counts) if count >= k), None)


@pytest.mark.parametrize("k", [2, 5])
def test_judged_points_searched_by_halving(k):
    both, check = features(40, 40, 2), Patchy(0.6, independent=False)
    known = known_one_by_one(both, check, 40)
    judged = verify_judged(verify(PAIR, *both, check, repeats=3), check, 40, repeats=3)
    assert judged.verifier.repeats == 3
    found = judged.points_needed(k, 40)
    assert found is not None
    assert inliers_among(both, known, check, found) >= k
    assert found == k or inliers_among(both, known, check, found - 1) < k


@pytest.mark.parametrize("independent", [True, False])
def test_where_everything_is_known_nothing_is_verified_again(independent):
    both, check = features(40, 40, 0), Patchy(1.1, independent)
    verified = verify(PAIR, *both, check)
    assert verified.points_needed(5, 40) is not None
    calls = check.calls
    assert verify_judged(verified, check, 40) is verified
    assert check.calls == calls


@pytest.mark.parametrize("independent", [True, False])
def test_where_nothing_is_known_no_point_is_left(independent):
    both, check = features(40, 40, 0), Patchy(-1, independent)
    judged = verify_judged(verify(PAIR, *both, check), check, 40)
    assert (len(judged.features0), len(judged.features1)) == (0, 0)
    assert judged.points_needed(1, 40) is None

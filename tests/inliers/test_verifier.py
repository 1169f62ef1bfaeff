import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sips_lit.inliers.verifier import (
    ExactVerifier,
    SearchVerifier,
    binary_search,
    inliers_by_budget,
    points_needed,
)
from sips_lit.matching.mutual_nearest import mutual_nearest, mutual_nearest_lifetimes
from sips_lit.types import Inliers, Reason

N = 30


@given(st.data())
@settings(max_examples=150, deadline=None)
def test_inliers_by_budget_equals_cropping_matching_and_verifying_again(data):
    shape = data.draw(st.tuples(st.integers(0, 8), st.integers(0, 8)))
    matrix = data.draw(hnp.arrays(np.float32, shape, elements=st.integers(0, 6).map(float)))
    truth = data.draw(hnp.arrays(np.bool_, shape))
    n_max = data.draw(st.integers(0, 12))

    def crop_and_verify(n: int) -> int:
        matches = mutual_nearest(matrix[:n, :n])
        return int(truth[matches.index0, matches.index1].sum())

    lifetimes = mutual_nearest_lifetimes(matrix)
    inliers = inliers_by_budget(lifetimes, truth[lifetimes.index0, lifetimes.index1], n_max)
    assert inliers.dtype == np.int64
    assert inliers.tolist() == [crop_and_verify(n) for n in range(n_max + 1)]


def test_points_needed_is_the_first_even_where_inliers_are_lost_again():
    inliers = np.array([0, 1, 2, 1, 1, 3])
    assert points_needed(inliers, 2) == 2
    assert points_needed(inliers, 3) == 5
    assert points_needed(inliers, 4) is None


@given(st.lists(st.integers(0, 1), min_size=1, max_size=60), st.integers(1, 12))
@settings(max_examples=100, deadline=None)
def test_binary_search_equals_the_exact_one_where_inliers_grow(steps, k):
    inliers = np.concatenate([[0], np.cumsum(steps)])
    n_max = len(steps)
    asked: list[int] = []

    def count(n: int) -> int:
        asked.append(n)
        return int(inliers[n])

    assert binary_search(count, k, n_max) == points_needed(inliers, k)
    assert len(asked) <= 1 + np.ceil(np.log2(n_max + 1))
    assert all(k <= n <= n_max for n in asked)


def test_binary_search_can_miss_where_inliers_are_lost_again():
    inliers = [0, 1, 2, 1, 1]
    assert points_needed(np.array(inliers), 2) == 2
    assert binary_search(inliers.__getitem__, 2, 4) is None


def scene(seed: int):
    """Distances between N points of both images, and which pairs of points are inliers."""
    generator = np.random.default_rng(seed)
    return generator.random((N, N)), generator.random((N, N)) < 0.5


def truly(matches, truth) -> Inliers:
    inlier = truth[matches.index0, matches.index1]
    reason = np.where(inlier, Reason.INLIER, Reason.FAR).astype(np.uint8)
    return Inliers(inlier, reason, np.ones(N, bool), np.arange(N) % 2 == 0)


def counts(distance, truth):
    """Inliers at every budget, by cropping and matching anew."""
    return [int(truly(mutual_nearest(distance[:n, :n]), truth).inlier.sum()) for n in range(N + 1)]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_exact(seed):
    distance, truth = scene(seed)
    lifetimes = mutual_nearest_lifetimes(distance)
    verifier = ExactVerifier(lifetimes, truly(lifetimes.matches, truth), N)
    expected = counts(distance, truth)
    for n in range(1, N + 1):
        verified = verifier.at(n, 0)
        assert verified.inlier_count == expected[n]
        assert len(verified.inliers.known0) == len(verified.inliers.known1) == n
        assert len(verified.matches) == len(verified.inliers.inlier) == len(mutual_nearest(distance[:n, :n]))
    for k in (1, 3, 6):
        enough = [n for n in range(N + 1) if expected[n] >= k]
        assert verifier.needed(k, N, 0) == (enough[0] if enough else None)
        within = [n for n in enough if n <= 12]
        assert verifier.needed(k, 12, 0) == (within[0] if within else None)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_searched(seed):
    """What is found has k inliers and its predecessor lacks them; the exact one where inliers only grow."""
    distance, truth = scene(seed)
    verifier = SearchVerifier(mutual_nearest_lifetimes(distance), lambda m, repeat: truly(m, truth), 2)
    expected = counts(distance, truth)
    for k in (1, 3, 6):
        found = verifier.needed(k, N, 1)
        if found is None:
            assert expected[N] < k
            continue
        assert expected[found] >= k > expected[found - 1]
        if all(np.diff((np.array(expected) >= k).astype(int)) >= 0):
            assert found == expected.index(next(c for c in expected if c >= k))


class Asked:
    """Remembers what it is asked."""

    def __init__(self, truth):
        self.truth, self.matches = truth, []

    def __call__(self, matches, repeat):
        self.matches.append((repeat, tuple(matches.index0), tuple(matches.index1)))
        return truly(matches, self.truth)


def test_nothing_is_asked_twice_and_searches_share():
    distance, truth = np.abs(np.subtract.outer(np.arange(N), np.arange(N))) + 0.0, np.ones((N, N), bool)
    asked = Asked(truth)
    verifier = SearchVerifier(mutual_nearest_lifetimes(distance), asked, 1)
    assert [verifier.needed(k, N, 0) for k in (4, 5, 6)] == [4, 5, 6]
    together = len(asked.matches)
    assert len(set(asked.matches)) == together
    alone = 0
    for k in (4, 5, 6):
        one = Asked(truth)
        SearchVerifier(mutual_nearest_lifetimes(distance), one, 1).needed(k, N, 0)
        assert len(one.matches) <= 6
        alone += len(one.matches)
    assert together < alone
    verifier.at(5, 0)
    assert len(asked.matches) == together


def test_repeats_see_the_matches_in_another_order():
    distance = np.abs(np.subtract.outer(np.arange(N), np.arange(N))) + 0.0
    asked = Asked(np.ones((N, N), bool))
    verifier = SearchVerifier(mutual_nearest_lifetimes(distance), asked, 3)
    orders = [verifier.at(20, repeat).matches.index0 for repeat in range(3)]
    assert [repeat for repeat, *_ in asked.matches] == [0, 1, 2]
    assert len({tuple(order) for order in orders}) == 3
    assert all(sorted(order) == list(range(20)) for order in orders)
    again = SearchVerifier(mutual_nearest_lifetimes(distance), asked, 3).at(20, 2).matches.index0
    np.testing.assert_array_equal(again, orders[2])
    np.testing.assert_array_equal(verifier.at(20, 0).matches.index0, verifier.at(20, 0).matches.index1)


def test_no_points():
    lifetimes = mutual_nearest_lifetimes(np.zeros((0, 0)))
    nothing = Inliers(np.zeros(0, bool), np.zeros(0, np.uint8), np.zeros(0, bool), np.zeros(0, bool))
    for verifier in (ExactVerifier(lifetimes, nothing, N), SearchVerifier(lifetimes, lambda m, r: nothing, 1)):
        assert verifier.needed(1, N, 0) is None
        assert verifier.at(N, 0).inlier_count == 0


def test_a_search_stays_in_its_repeat():
    distance = np.abs(np.subtract.outer(np.arange(N), np.arange(N))) + 0.0
    asked = Asked(np.ones((N, N), bool))
    SearchVerifier(mutual_nearest_lifetimes(distance), asked, 3).needed(5, N, 2)
    assert {repeat for repeat, *_ in asked.matches} == {2}

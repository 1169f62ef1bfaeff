import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sips_lit.inliers.budgets import binary_search, inliers_by_budget, points_needed
from sips_lit.match.mutual_nearest import mutual_nearest, mutual_nearest_lifetimes


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

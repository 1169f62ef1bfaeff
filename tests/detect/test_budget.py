"""The budget of points against enumeration of all outcomes and the binomial distribution."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_pairs import conditional_by_bisection

from sips_lit.detect.budget import Budget, enough_inliers, enough_inliers_together, smallest_budget
from sips_lit.detect.recalibration import Recalibration
from sips_lit.errors import BadInputError
from sips_lit.types import Keypoints


def keypoints_of(scores: list[float]) -> Keypoints:
    count = len(scores)
    xy = np.stack([np.arange(count), np.arange(count)], 1).astype(np.float32)
    return Keypoints(xy, np.array(scores, np.float32), np.ones(count, np.float32))


def by_enumeration(probability: list[float], k: int) -> float:
    """P(at least k) by adding up the probabilities of all 2^N outcomes."""
    total = 0.0
    for outcome in itertools.product([0, 1], repeat=len(probability)):
        if sum(outcome) >= k:
            total += math.prod(p if hit else 1 - p for p, hit in zip(probability, outcome, strict=True))
    return total


@given(st.lists(st.floats(0, 1), max_size=8), st.integers(0, 9))
@settings(max_examples=40, deadline=None)
def test_probability_of_enough_inliers_is_that_of_all_outcomes(probability: list[float], k: int) -> None:
    expected = [by_enumeration(probability[:n], k) for n in range(len(probability) + 1)]
    np.testing.assert_allclose(enough_inliers(np.array(probability), k), expected, atol=1e-12)


@pytest.mark.parametrize(("p", "k"), [(0.5, 10), (0.9, 30), (0.02, 3)])
def test_equal_points_are_binomial(p: float, k: int) -> None:
    n = 120
    tail = math.fsum(math.comb(n, j) * p**j * (1 - p) ** (n - j) for j in range(k, n + 1))
    assert enough_inliers(np.full(n, p), k)[-1] == pytest.approx(tail, rel=1e-10)


def test_tiny_probabilities_do_not_cancel() -> None:
    assert enough_inliers(np.full(4, 1e-6), 4)[-1] == pytest.approx(1e-24, rel=1e-10)


@given(st.lists(st.floats(0, 1), max_size=12), st.integers(1, 5), st.floats(0.05, 0.99))
@settings(max_examples=40, deadline=None)
def test_smallest_budget_is_enough_and_one_less_is_not(probability: list[float], k: int, confidence: float) -> None:
    points = sorted(probability, reverse=True)
    tail = enough_inliers(np.array(points), k)
    n = smallest_budget(np.array(points), k, confidence)
    if n is None:
        assert tail[-1] < confidence
    else:
        assert tail[n] >= confidence > tail[n - 1]


def plain_budget(probability: np.ndarray, k: int, confidence: float, recalibration: Recalibration) -> int | None:
    """The first of all numbers of points that is enough, one after the other."""
    for n in range(len(probability) + 1):
        kept = recalibration.moved(probability[:n], len(probability), n)
        if enough_inliers_together(kept, k, recalibration.difficulty)[-1] >= confidence:
            return n
    return None


@given(
    st.lists(st.floats(0.0, 1.0, width=32), max_size=40),
    st.integers(1, 6),
    st.floats(0.05, 0.99),
    st.sampled_from([0.0, 0.3]),
    st.sampled_from([0.0, 1.0]),
)
@settings(max_examples=60, deadline=None)
def test_the_search_by_doubling_finds_the_first_number(points, k, confidence, log_n, difficulty):
    probability = np.sort(np.array(points, np.float32))[::-1]
    recalibration = Recalibration(log_n=log_n, difficulty=difficulty)
    found = smallest_budget(probability, k, confidence, recalibration)
    assert found == plain_budget(probability, k, confidence, recalibration)


def test_certain_points_need_exactly_k() -> None:
    assert smallest_budget(np.ones(20), 10, 0.999) == 10
    assert smallest_budget(np.ones(9), 10, 0.5) is None
    assert smallest_budget(np.zeros(0), 1, 0.5) is None


def test_just_the_confidence_that_is_asked_for_is_enough() -> None:
    assert smallest_budget(np.array([0.75, 0.9]), 1, 0.75) == 1


def test_fixed_budget_cuts_and_never_misses() -> None:
    points = keypoints_of([0.9, 0.5, 0.1])
    for n, left in [(0, 0), (2, 2), (3, 3), (1000, 3)]:
        kept, enough = Budget(n).keep(points)
        assert (len(kept), enough) == (left, True)
        np.testing.assert_array_equal(kept.xy, points.xy[:left])


def test_threshold_keeps_equal_scores_and_combines_with_the_others() -> None:
    points = keypoints_of([0.9, 0.7, 0.7, 0.3])
    assert len(Budget(threshold=0.95).keep(points)[0]) == 0
    assert len(Budget(n=2, threshold=0.7).keep(points)[0]) == 2
    assert len(Budget(n=50, threshold=0.7).keep(points)[0]) == 3
    kept, enough = Budget(threshold=0.7, k=3, confidence=0.5).keep(points)  # 0.9 * 0.7 * 0.7 = 0.44
    assert (len(kept), enough) == (3, False)
    kept, enough = Budget(k=3, confidence=0.5).keep(points)
    assert (len(kept), enough) == (4, True)


def test_inliers_out_of_reach_keep_every_point_up_to_n_max_and_say_so() -> None:
    points = keypoints_of([0.5] * 30)
    kept, enough = Budget(n=5, k=18, n_max=20).keep(points)
    assert (len(kept), enough) == (20, False)
    kept, enough = Budget(n=5, k=2, confidence=0.9, n_max=20).keep(points)
    assert (len(kept), enough) == (7, True)  # 1 - 8 / 128 = 0.9375, while 6 points give 0.891


def test_fifty_points_or_95_percent_of_at_most_500_by_default() -> None:
    many = keypoints_of([0.7] * 600)
    assert len(Budget().keep(many)[0]) == 50
    assert len(Budget(k=1).keep(many)[0]) == 3  # 1 - 0.3^2 = 0.91, 1 - 0.3^3 = 0.973
    assert len(Budget(k=490).keep(many)[0]) == 500


def test_no_points_at_all() -> None:
    kept, enough = Budget().keep(Keypoints.empty())
    assert (len(kept), enough) == (0, True)
    assert Budget(k=1).keep(Keypoints.empty())[1] is False


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        ({"n": -1}, "n is -1"),
        ({"threshold": 1.5}, "threshold is 1.5"),
        ({"threshold": float("nan")}, "threshold is nan"),
        ({"k": 0}, "k is 0"),
        ({"k": 3, "confidence": 1.0}, "confidence is 1"),
        ({"k": 3, "confidence": 0.0}, "confidence is 0"),
        ({"k": 3, "confidence": float("nan")}, "confidence is nan"),
        ({"k": 3, "n_max": 0}, "n_max is 0"),
        ({"k": 21, "n_max": 20}, "k is 21 and n_max is 20"),
    ],
)
def test_values_out_of_range_are_named(arguments: dict[str, float], key: str) -> None:
    with pytest.raises(BadInputError, match=key):
        Budget(**arguments)  # type: ignore[arg-type]  # wrong on purpose


def test_points_that_share_an_effect_against_drawing_them() -> None:
    """The slow twin: draw the effect, then the points."""
    p, k, deviation = np.linspace(0.9, 0.3, 30), 10, 1.3
    generator = np.random.default_rng(0)
    delta = np.array([conditional_by_bisection(float(each), deviation) for each in p])
    logits = delta + deviation * generator.normal(size=(40_000, 1))
    counts = np.cumsum(generator.random(logits.shape) < 1 / (1 + np.exp(-logits)), axis=1)
    drawn = (counts >= k).mean(0)
    np.testing.assert_allclose(enough_inliers_together(p, k, deviation)[1:], drawn, atol=0.01)
    np.testing.assert_array_equal(enough_inliers_together(p, k, 0.0), enough_inliers(p, k))
    assert enough_inliers_together(p, k, deviation)[20] < enough_inliers(p, k)[20] - 0.05


@pytest.mark.parametrize("log_n", [0.0, 0.4])
@pytest.mark.parametrize("threshold", [None, 0.45])
def test_a_recalibrated_budget_is_the_first_that_is_enough_as_if_each_were_tried(
    log_n: float, threshold: float | None
) -> None:
    recalibration = Recalibration(1.0, 0.0, log_n, 0.9)
    points = keypoints_of(list(np.linspace(0.95, 0.4, 80)))
    budget = Budget(k=8, confidence=0.9, threshold=threshold, n_max=80)
    kept, enough = budget.keep(points, recalibration)

    def tried(n: int) -> bool:
        score = recalibration.best(points, n).score
        clear = threshold is None or score[-1] >= threshold
        return clear and float(enough_inliers_together(score, 8, 0.9)[-1]) >= 0.9

    assert enough
    assert len(kept) == next(n for n in range(1, 81) if tried(n))
    np.testing.assert_allclose(kept.score, recalibration.best(points, len(kept)).score, atol=1e-6)
    assert threshold is None or kept.score[-1] >= threshold


def test_a_recalibrated_budget_out_of_reach_keeps_all_points() -> None:
    points = keypoints_of([0.5] * 30)
    kept, enough = Budget(k=14, confidence=0.9, n_max=30).keep(points, Recalibration(1, 0, 0.2, 1))
    assert (len(kept), enough) == (30, False)
    assert Budget(k=3).keep(Keypoints.empty(), Recalibration(1, 0, 0.2, 1))[1] is False

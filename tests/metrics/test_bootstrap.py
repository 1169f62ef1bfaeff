import math

import numpy as np
import pytest

from sips_lit.metrics.bootstrap import (
    FEWEST_GROUPS,
    difference,
    draw_pairs,
    draws_groups,
    first_reached,
    interval,
    resampled_curves,
    resampled_mean,
)
from sips_lit.metrics.pose_auc import pose_auc
from sips_lit.metrics.succinctness import histogram, summarise


def one_group(pairs: int) -> list[str]:
    return ["drive"] * pairs


def grouped(sizes) -> list[str]:
    return [f"scene {index}" for index, size in enumerate(sizes) for _ in range(size)]


def test_draws_of_one_sequence_are_of_pairs():
    drawn = draw_pairs(one_group(30), 2000, 5)
    assert drawn.shape == (2000, 30)
    assert (drawn.sum(1) == 30).all()
    # each pair is drawn about once, with the variance of a binomial of 30 trials
    np.testing.assert_allclose(drawn.mean(0), 1, atol=0.12)
    assert drawn.var() == pytest.approx(1 - 1 / 30, rel=0.05)
    np.testing.assert_array_equal(drawn, draw_pairs(one_group(30), 2000, 5))
    assert (drawn != draw_pairs(one_group(30), 2000, 6)).any()


def test_few_sequences_keep_their_number_of_pairs():
    sizes = (3, 7, 2)
    drawn = draw_pairs(grouped(sizes), 50, 0)
    assert not draws_groups(grouped(sizes))
    for part, size in zip(np.split(drawn, np.cumsum(sizes)[:-1], axis=1), sizes, strict=True):
        assert (part.sum(1) == size).all()
        assert (part > 1).any()


def test_sequences_of_a_single_pair_are_drawn_together():
    """By themselves they would be in every draw once: intervals of nine such sequences had no width."""
    drawn = draw_pairs(grouped([1] * 9), 2000, 0)
    assert (drawn.sum(1) == 9).all()
    assert drawn.var() == pytest.approx(1 - 1 / 9, rel=0.05)  # of a binomial of 9 trials
    mixed = draw_pairs(grouped([1, 5, 1, 1]), 200, 0)
    alone = mixed[:, [0, 6, 7]]
    assert (alone.sum(1) == 3).all()
    assert (alone > 1).any(0).all()
    assert (mixed[:, 1:6].sum(1) == 5).all()


def test_many_sequences_are_drawn_whole_wherever_their_pairs_stand():
    sizes = [1 + index % 4 for index in range(FEWEST_GROUPS)]
    groups = np.random.default_rng(0).permutation(grouped(sizes)).tolist()
    assert draws_groups(groups)
    drawn = draw_pairs(groups, 100, 0)
    for row in drawn:
        of_group = {}
        for group, count in zip(groups, row, strict=True):
            assert of_group.setdefault(group, count) == count
        assert sum(of_group.values()) == FEWEST_GROUPS
    assert len(set(drawn.sum(1).tolist())) > 1  # the sequences have different numbers of pairs


def expanded(row) -> list[int]:
    """The pairs of a draw, one by one."""
    return [pair for pair, count in enumerate(row) for _ in range(count)]


def test_curves_of_draws_are_those_of_the_pairs_one_by_one():
    generator, n_max, k = np.random.default_rng(1), 40, 10
    needed = generator.integers(k, 51, (12, 3)).astype(float)
    needed[needed > n_max] = np.inf
    drawn = draw_pairs(one_group(12), 25, 2)
    curves = resampled_curves(needed, n_max, drawn)
    at_80 = first_reached(curves, 0.8)
    for row, curve, n in zip(drawn, curves, at_80, strict=True):
        values = needed[expanded(row)].ravel()
        result = summarise(histogram([int(x) if x < np.inf else None for x in values], n_max), k)
        np.testing.assert_allclose(curve, result.curve, atol=1e-12)
        assert n == (math.inf if result.n_at_80 is None else result.n_at_80)
    assert np.isinf(at_80).any()
    assert np.isfinite(at_80).any()


def test_means_of_draws_leave_out_what_is_not_known():
    generator = np.random.default_rng(3)
    errors = generator.exponential(0.7, (9, 2))
    errors[4] = np.inf
    errors[6] = np.nan
    gains = np.maximum(1 - errors, 0)
    drawn = draw_pairs(one_group(9), 30, 4)
    for row, mean in zip(drawn, resampled_mean(gains, drawn), strict=True):
        values = errors[expanded(row)].ravel()
        assert mean == pytest.approx(pose_auc(values[~np.isnan(values)], 1.0))
    assert np.isnan(resampled_mean(np.full(9, np.nan), drawn)).all()


def test_the_interval_of_a_mean_is_scipys():
    stats = pytest.importorskip("scipy.stats")
    values = np.random.default_rng(0).gamma(2.0, 1.0, 50)
    low, high = interval(resampled_mean(values, draw_pairs(one_group(50), 20_000, 0)))
    theirs = stats.bootstrap((values,), np.mean, n_resamples=20_000, method="percentile", random_state=1)
    # the ends of 20 000 draws are known to about a hundredth of the width
    width = high - low
    assert low == pytest.approx(theirs.confidence_interval.low, abs=0.03 * width)
    assert high == pytest.approx(theirs.confidence_interval.high, abs=0.03 * width)


def test_the_interval_of_a_paired_difference_is_scipys():
    stats = pytest.importorskip("scipy.stats")
    generator = np.random.default_rng(2)
    hard = generator.gamma(2.0, 1.0, 40)
    a, b = hard + generator.normal(0.2, 0.1, 40), hard + generator.normal(0, 0.1, 40)
    drawn = draw_pairs(one_group(40), 20_000, 0)
    low, high = interval(difference(resampled_mean(a, drawn), resampled_mean(b, drawn)))
    theirs = stats.bootstrap(
        (a, b),
        lambda x, y, axis: np.mean(x, axis) - np.mean(y, axis),
        paired=True,
        n_resamples=20_000,
        method="percentile",
        random_state=1,
    ).confidence_interval
    assert (low, high) == pytest.approx((theirs.low, theirs.high), abs=0.03 * (high - low))
    apart = interval(resampled_mean(a, drawn)), interval(resampled_mean(b, drawn))
    assert low > 0
    assert apart[0][0] < apart[1][1]  # each by itself can't tell them apart


def covered(groups, values_of, truth, trials=250):
    """How many of the intervals of a mean hold the true one."""
    hits = 0
    for trial in range(trials):
        values = values_of(np.random.default_rng(trial))
        low, high = interval(resampled_mean(values, draw_pairs(groups, 400, trial)))
        hits += low <= truth <= high
    return hits / trials


def test_95_of_100_intervals_hold_the_truth():
    assert 0.9 < covered(one_group(60), lambda generator: generator.exponential(1.0, 60), 1.0) < 0.99


def test_pairs_of_one_sequence_are_no_evidence_about_others():
    """With differences between sequences, drawing them covers the truth; drawing pairs pretends to know five times more."""
    sequences, each = 30, 6

    def values(generator):
        return np.repeat(generator.normal(0, 1, sequences), each) + generator.normal(0, 0.3, sequences * each)

    assert covered(grouped([each] * sequences), values, 0.0) > 0.88
    assert covered(one_group(sequences * each), values, 0.0) < 0.75


def test_an_end_may_be_infinite():
    samples = np.array([20.0] * 90 + [np.inf] * 10)
    assert interval(samples) == (20, np.inf)
    assert interval(np.full(50, np.inf)) == (np.inf, np.inf)
    assert interval(np.array([np.nan, 3.0])) == (3, 3)
    assert np.isnan(interval(np.full(5, np.nan))).all()
    low, high = interval(np.arange(1000.0), 0.9)
    assert (low, high) == (49, 950)


def test_two_that_never_get_there_do_not_differ():
    a, b = np.array([np.inf, np.inf, 30, np.nan]), np.array([np.inf, 20, np.inf, 4])
    np.testing.assert_array_equal(difference(a, b), [0, np.inf, -np.inf, np.nan])

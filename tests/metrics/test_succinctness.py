import pickle

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.inliers.verifier import points_needed
from sips_lit.metrics.succinctness import Succinctness, histogram, summarise

N_KS = st.lists(st.none() | st.integers(0, 25), min_size=1, max_size=30)


def test_perfect_detector():
    result = summarise(histogram([10] * 7, 200), k=10)
    assert result.auc == pytest.approx(0.95)
    assert (result.n_at_80, result.median, result.failures, result.pairs) == (10, 10, 0, 7)
    assert result.curve[9] == 0
    assert result.curve[10] == 1


def test_eighty_per_cent_is_reached_exactly():
    assert summarise(histogram([10] * 12 + [None] * 3, 200), k=10).n_at_80 == 10
    assert summarise(histogram([10] * 11 + [50] + [None] * 3, 200), k=10).n_at_80 == 50
    assert summarise(histogram([10] * 11 + [None] * 4, 200), k=10).n_at_80 is None


def test_median_is_none_only_if_over_half_fail():
    assert summarise(histogram([12, None], 200), k=10).median == 12
    assert summarise(histogram([12, None, None], 200), k=10).median is None


@given(N_KS)
@settings(max_examples=100, deadline=None)
def test_summary_equals_the_definition(n_ks):
    n_max = 20
    result = summarise(histogram(n_ks, n_max), k=10)
    successes = [n for n in n_ks if n is not None and n <= n_max]
    s = [sum(n_k <= n for n_k in successes) / len(n_ks) for n in range(n_max + 1)]
    np.testing.assert_allclose(result.curve, s)
    assert result.auc == pytest.approx(np.mean(s[:n_max]))
    assert result.failures == len(n_ks) - len(successes)
    assert result.failure_rate == result.failures / len(n_ks)
    assert points_needed(result.curve, 0.3) == next((n for n in range(n_max + 1) if s[n] >= 0.3), None)
    ordered = sorted(np.inf if n is None or n > n_max else n for n in n_ks)
    middle = ordered[(len(ordered) - 1) // 2]
    assert result.median == (None if middle == np.inf else middle)


def test_negative_counts_are_refused():
    with pytest.raises(ValueError, match="-1"):
        histogram([3, -1], 20)


@pytest.mark.parametrize(("k", "n_max"), [(0, 200), (200, 200)])
def test_impossible_budgets_are_refused(k, n_max):
    with pytest.raises(ValueError, match="n_max"):
        Succinctness(k, n_max)


@given(N_KS, N_KS)
@settings(max_examples=30, deadline=None)
def test_states_add_exactly(a, b):
    whole, part = Succinctness(5, 20), Succinctness(5, 20)
    whole.update(a + b)
    for n_k in a:
        part.update(n_k)
    other = Succinctness(5, 20)
    other.update(iter(b))
    part.counts += other.counts
    np.testing.assert_array_equal(part.result().curve, whole.result().curve)
    for name, value in part.compute().items():
        torch.testing.assert_close(value, whole.compute()[name], rtol=0, atol=0, equal_nan=True)


def test_results_of_processes_are_merged_and_the_own_state_is_kept():
    def two_alike(state: torch.Tensor, group: object) -> list[torch.Tensor]:
        return [state, state]

    metric = Succinctness(dist_sync_fn=two_alike, distributed_available_fn=lambda: True)
    metric.update([10, None])
    assert metric.result().pairs == 4
    assert metric.compute()["failure_rate"] == 0.5
    assert metric.counts.sum() == 2


def test_metric_computes_the_summary_and_survives_reset_and_pickling():
    metric = Succinctness()
    metric.update([10, 30, None, 200])
    values = pickle.loads(pickle.dumps(metric)).compute()
    expected = summarise(histogram([10, 30, None, 200], 200), 10)
    assert values["auc"].item() == pytest.approx(expected.auc)
    assert (values["median"], values["failure_rate"]) == (30, 0.25)
    assert torch.isnan(values["n_at_80"])
    metric.reset()
    metric.update(10)
    assert metric.compute()["auc"].item() == pytest.approx(0.95)


def test_no_pairs_are_nan_and_none():
    metric = Succinctness()
    with pytest.warns(UserWarning, match="before the ``update``"):
        values = metric.compute()
    assert all(torch.isnan(value) for value in values.values())
    result = metric.result()
    assert np.isnan([result.auc, result.failure_rate]).all()
    assert (result.n_at_80, result.median, result.pairs) == (None, None, 0)

import pickle

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torchmetrics.functional.classification import binary_calibration_error

from sips_lit.errors import BadInputError
from sips_lit.metrics.calibration import Calibration, bin_sums, summarise

POINTS = st.lists(st.tuples(st.floats(0, 1, width=32), st.booleans()), min_size=1, max_size=40)


def calibration_by_loop(points: list[tuple[float, bool]], bins: int) -> tuple[float, float, float]:
    members: list[list[tuple[float, bool]]] = [[] for _ in range(bins)]
    edges = np.linspace(0, 1, bins + 1)
    for score, label in points:
        inside = [b for b in range(bins) if edges[b] <= score < edges[b + 1]] or [bins - 1]
        members[inside[0]].append((score, label))
    ece, mce = 0.0, 0.0
    for member in filter(None, members):
        gap = abs(np.mean([label for _, label in member]) - np.mean([score for score, _ in member]))
        ece += gap * len(member) / len(points)
        mce = max(mce, gap)
    return ece, mce, float(np.mean([(score - label) ** 2 for score, label in points]))


@given(POINTS, st.integers(1, 25))
@settings(max_examples=100, deadline=None)
def test_errors_equal_the_loop(points, bins):
    result = summarise(bin_sums([s for s, _ in points], [label for _, label in points], bins))
    assert (result.ece, result.mce, result.brier) == pytest.approx(calibration_by_loop(points, bins), abs=1e-12)
    assert result.points == len(points)


@pytest.mark.parametrize("bins", [10, 20])
def test_errors_equal_torchmetrics(bins):
    rng = np.random.default_rng(0)
    scores = rng.beta(0.7, 0.7, 5000).astype(np.float32).clip(0, 0.999)
    labels = rng.random(5000) < scores**2
    result = summarise(bin_sums(scores, labels, bins))
    for name, norm in (("ece", "l1"), ("mce", "max")):
        expected = binary_calibration_error(torch.from_numpy(scores), torch.from_numpy(labels).int(), bins, norm)
        assert getattr(result, name) == pytest.approx(expected.item(), abs=1e-5), name


def test_one_belongs_to_the_last_bin_and_an_edge_to_the_bin_above():
    result = summarise(bin_sums([1.0, 0.96, 0.0, 0.5], [1, 0, 0, 1]))
    assert np.flatnonzero(result.count).tolist() == [0, 10, 19]
    assert result.count[19] == 2
    assert result.frequency[19] == 0.5
    assert result.mean_score[19] == pytest.approx(0.98)
    assert np.isnan(result.frequency[1])
    assert result.edges[10] == 0.5


@pytest.mark.parametrize("score", [np.nan, -0.01, 1.01])
def test_scores_that_are_no_probabilities_are_refused(score):
    with pytest.raises(ValueError, match="probabilities"):
        bin_sums([0.5, score], [0, 1])


def test_other_bad_input_is_refused():
    with pytest.raises(ValueError, match=r"\(2,\) and \(3,\)"):
        bin_sums([0.5, 0.5], [0, 1, 1])
    with pytest.raises(ValueError, match="0 or 1"):
        bin_sums([0.5], [2])


@given(POINTS, POINTS)
@settings(max_examples=50, deadline=None)
def test_states_add(a, b):
    def metric_of(points: list[tuple[float, bool]]) -> Calibration:
        metric = Calibration()
        metric.update(torch.tensor([s for s, _ in points]), torch.tensor([label for _, label in points]))
        return metric

    merged = metric_of(a)
    merged.sums += metric_of(b).sums
    result = merged.result()
    assert (result.ece, result.mce, result.brier) == pytest.approx(calibration_by_loop(a + b, 20), abs=1e-6)
    assert result.points == len(a) + len(b)


def test_updates_add():
    metric, scores, labels = Calibration(bins=5), [0.1, 0.7, 0.75, 0.3], [True, True, False, False]
    for part in (slice(0, 1), slice(1, 4)):
        metric.update(torch.tensor(scores[part]), torch.tensor(labels[part]))
    expected = calibration_by_loop(list(zip(scores, labels, strict=True)), 5)
    result, scalars = metric.result(), metric.compute()
    assert (result.ece, result.mce, result.brier) == pytest.approx(expected, abs=1e-6)
    assert [scalars[name].item() for name in ("ece", "mce", "brier")] == pytest.approx(expected, abs=1e-6)
    assert expected[0] != pytest.approx(expected[1], abs=0.01)


def test_processes_are_merged():
    def and_another(state: torch.Tensor, group: object) -> list[torch.Tensor]:
        other = Calibration(bins=5)
        other.update(torch.tensor([0.7, 0.75, 0.3]), torch.tensor([True, False, False]))
        return [state, other.sums]

    metric = Calibration(bins=5, dist_sync_fn=and_another, distributed_available_fn=lambda: True)
    metric.update(torch.tensor([0.1]), torch.tensor([True]))
    expected = calibration_by_loop([(0.1, True), (0.7, True), (0.75, False), (0.3, False)], 5)
    assert metric.result().points == 4
    assert metric.compute()["brier"].item() == pytest.approx(expected[2], abs=1e-6)


def test_metric_survives_reset_and_pickling_and_takes_half_precision():
    metric = Calibration(bins=4)
    metric.update(torch.tensor([0.75, 1.0], dtype=torch.bfloat16, requires_grad=True), torch.tensor([0, 1]))
    values = pickle.loads(pickle.dumps(metric)).compute()
    assert values["ece"].item() == pytest.approx(0.375)
    assert values["brier"].item() == pytest.approx(0.75**2 / 2)
    metric.reset()
    assert metric.result().points == 0


def test_no_points_are_nan():
    metric = Calibration()
    metric.update(torch.zeros(0), torch.zeros(0, dtype=torch.bool))
    assert all(torch.isnan(value) for value in metric.compute().values())
    assert np.isnan(metric.result().mean_score).all()


@pytest.mark.parametrize("bins", [-1, 0])
def test_without_bins_there_is_nothing_to_count(bins):
    with pytest.raises(BadInputError, match=f"bins of the calibration is {bins}: give a whole number above 0"):
        Calibration(bins)

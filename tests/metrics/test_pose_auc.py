import pickle

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.metrics.pose_auc import PoseAuc, pose_auc

ERRORS = st.lists(st.floats(0, 3) | st.just(np.inf), min_size=1, max_size=20)


def test_by_hand():
    assert pose_auc([0, 0], 1.0) == 1
    assert pose_auc([0.25], 1.0) == 0.75
    assert pose_auc([0.25, 0.5, 2, np.inf], 1.0) == pytest.approx((0.75 + 0.5) / 4)
    assert pose_auc([1.0, 4.0], 5.0) == pytest.approx((0.8 + 0.2) / 2)
    assert pose_auc([1.0, np.inf], 1.0) == 0


@given(ERRORS, st.floats(0.5, 2))
@settings(max_examples=50, deadline=None)
def test_equals_the_integral_of_the_fraction_of_pairs(errors, limit):
    edges = np.sort(np.array([0.0, *[e for e in errors if e < limit], limit]))
    middles = (edges[1:] + edges[:-1]) / 2  # between two errors the fraction does not change
    fraction = [np.mean([e <= x for e in errors]) for x in middles]
    assert pose_auc(errors, limit) == pytest.approx(np.sum(np.diff(edges) * fraction) / limit, abs=1e-12)


def test_nothing_is_nan():
    assert np.isnan(pose_auc([], 1.0))


@pytest.mark.parametrize("errors", [[-0.1], [np.nan]])
def test_what_is_no_error_is_refused(errors):
    with pytest.raises(ValueError, match="infinite error"):
        pose_auc(errors, 1.0)


@pytest.mark.parametrize("limit", [0.0, -1.0, np.inf, np.nan])
def test_impossible_limits_are_refused(limit):
    with pytest.raises(ValueError, match="limit"):
        PoseAuc(rotation_limit=limit)


def test_metric_takes_pairs_one_by_one_or_together_and_survives_pickling():
    metric = PoseAuc(translation_limit=1.0, rotation_limit=5.0)
    metric.update(0.25, 1.0)
    metric.update([0.5, np.inf], [4.0, np.inf])
    values = pickle.loads(pickle.dumps(metric)).compute()
    assert values["translation"].item() == pytest.approx(pose_auc([0.25, 0.5, np.inf], 1.0))
    assert values["rotation"].item() == pytest.approx(pose_auc([1, 4, np.inf], 5.0))
    metric.reset()
    metric.update(0.0, 0.0)
    assert metric.compute()["translation"] == 1


@given(ERRORS, ERRORS)
@settings(max_examples=20, deadline=None)
def test_states_add_exactly(a, b):
    whole, parts = PoseAuc(), [PoseAuc(), PoseAuc()]
    whole.update(b + a, b + a)
    for part, errors in zip(parts, (a, b), strict=True):
        for error in errors:
            part.update(error, error)
    assert torch.equal(parts[0].gained + parts[1].gained, whole.gained)
    assert parts[0].pairs + parts[1].pairs == whole.pairs


def test_processes_are_merged():
    def two_alike(state: torch.Tensor, group: object) -> list[torch.Tensor]:
        return [state, state]

    metric = PoseAuc(dist_sync_fn=two_alike, distributed_available_fn=lambda: True)
    metric.update([0.5, np.inf], [0.0, np.inf])
    values = metric.compute()
    assert values["translation"] == 0.25
    assert values["rotation"] == 0.5


def test_no_pairs_are_nan():
    with pytest.warns(UserWarning, match="before the ``update``"):
        values = PoseAuc().compute()
    assert all(torch.isnan(value) for value in values.values())


def test_both_errors_of_each_pair():
    with pytest.raises(ValueError, match="got 2 of translation, 1 of rotation"):
        PoseAuc().update([0.1, 0.2], [0.1])

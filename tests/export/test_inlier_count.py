import numpy as np
import pytest
import torch

from sips_lit.detect.budget import Budget, enough_inliers, enough_inliers_together
from sips_lit.detect.recalibration import AS_TRAINED, Recalibration
from sips_lit.detect.shared_effect import sigmoid
from sips_lit.export.inlier_count import fewer_inliers, points_to_keep, probability_of_k
from sips_lit.types import Keypoints

RECALIBRATIONS = [
    AS_TRAINED,
    Recalibration(1.2, -0.3, 0.4, 0.0),
    Recalibration(0.8, 0.2, 0.0, 1.3),
    Recalibration(1, 0, 0.5, 2),
]


def logits_of(count: int, seed: int, level: float = 0.0) -> np.ndarray:
    """Descending, (N,)."""
    drawn = np.random.default_rng(seed).normal(level, 1.5, count)
    return np.sort(drawn)[::-1].astype(np.float32)


@pytest.mark.parametrize(("points", "k"), [(1, 1), (5, 5), (37, 10), (64, 1), (200, 60)])
def test_the_product_is_the_recursion_over_points(points, k):
    logits = logits_of(points, points, -1)
    fewer = fewer_inliers(torch.from_numpy(logits)[:, None], k)
    assert fewer.shape == (1,)
    assert float(fewer) == pytest.approx(1 - enough_inliers(sigmoid(logits), k)[-1], abs=2e-6)


@pytest.mark.parametrize("recalibration", RECALIBRATIONS)
def test_points_that_share_an_effect(recalibration):
    logits, counts = logits_of(60, 1), np.array([[0, 9, 31, 60]])
    budget = Budget(k=8, n_max=60)
    mine = probability_of_k(torch.from_numpy(logits)[None], torch.from_numpy(counts), budget, recalibration)
    for value, count in zip(mine[0], counts[0], strict=True):
        kept = sigmoid(recalibration.logits(logits[:count].astype(float), int(count)))
        expected = enough_inliers_together(kept, 8, recalibration.difficulty)[-1]
        assert float(value) == pytest.approx(expected, abs=5e-6)


@pytest.mark.parametrize("recalibration", RECALIBRATIONS)
@pytest.mark.parametrize("level", [-4.0, -1.0, 1.0])
@pytest.mark.parametrize("threshold", [None, 0.3])
@pytest.mark.parametrize("k", [None, 1, 12])
def test_as_many_as_the_budget_keeps(recalibration, level, threshold, k):
    budget = Budget(70, threshold, k, 0.8, 70)
    rows, found, expected, is_enough = [], [70, 33, 5, 0], [], []
    for index, count in enumerate(found):
        logits = logits_of(count, 10 * index, level)
        rows.append(np.pad(logits, (0, 70 - count), constant_values=-np.inf))
        score = sigmoid(recalibration.logits(logits, count)).astype(np.float32)
        points, enough = budget.keep(
            Keypoints(np.zeros((count, 2), np.float32), score, np.ones(count, np.float32)), recalibration
        )
        expected.append(len(points))
        is_enough.append(enough)
    counts, enough = points_to_keep(torch.from_numpy(np.array(rows)), torch.tensor(found), budget, recalibration)
    assert counts.tolist() == expected
    assert (enough is None) == (k is None)
    if enough is not None:
        assert enough.tolist() == is_enough

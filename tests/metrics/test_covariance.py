import numpy as np
import pytest
import torch

from sips_lit.errors import BadInputError
from sips_lit.metrics.covariance import CovarianceCalibration, reliability_sums, squared_mahalanobis, summarise

TRUTH = np.array([[4.0, 0.5], [0.5, 0.25]])


def drawn(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).multivariate_normal([0, 0], TRUTH, count)


def claimed(covariance: np.ndarray, count: int) -> np.ndarray:
    return np.broadcast_to(covariance, (count, 2, 2))


def test_a_known_normal_is_reliable():
    result = summarise(reliability_sums(drawn(20_000), claimed(TRUTH, 20_000)))
    assert result.error < 0.01
    assert result.scale == pytest.approx(1, abs=0.03)
    np.testing.assert_allclose(result.within, result.edges, atol=0.015)
    assert result.residuals == 20_000


@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_claims_that_are_too_small_or_too_large(factor):
    """With covariances s times the truth 1 - exp(-d^2 / 2) = p holds at d^2 / s: within is 1 - (1 - p)^s."""
    result = summarise(reliability_sums(drawn(20_000), claimed(factor * TRUTH, 20_000)))
    np.testing.assert_allclose(result.within, 1 - (1 - result.edges) ** factor, atol=0.015)
    assert result.scale == pytest.approx(1 / factor, rel=0.03)
    inner = result.edges[1:-1]
    assert result.error == pytest.approx(np.abs(1 - (1 - inner) ** factor - inner).mean(), abs=0.01)


def test_swapped_axes_are_unreliable():
    result = summarise(reliability_sums(drawn(20_000)[:, ::-1], claimed(TRUTH, 20_000)))
    assert result.error > 0.15
    assert result.scale > 2


def test_distances_by_hand():
    covariance = np.array([[[4.0, 0.0], [0.0, 1.0]], [[2.0, 1.0], [1.0, 2.0]]])
    np.testing.assert_allclose(squared_mahalanobis([[2, 0], [1, 1]], covariance), [1, 2 / 3])
    sums = reliability_sums([[2, 0], [1, 1]], covariance, bins=2)  # 1 - exp(-1/2) = 0.39, 1 - exp(-1/3) = 0.28
    np.testing.assert_allclose(sums, [2, 0, 1 + 2 / 3, np.log(4) + np.log(3)])
    assert summarise(sums).nll == pytest.approx((1 + 2 / 3 + np.log(12)) / 4)


def test_the_metric_is_that_of_all_residuals_together():
    metric, residual, covariance = CovarianceCalibration(), drawn(500), claimed(TRUTH, 500)
    metric.update(residual[:100], covariance[:100])
    metric.update(residual[100:], covariance[100:])
    whole, result = summarise(reliability_sums(residual, covariance)), metric.result()
    np.testing.assert_array_equal(result.count, whole.count)
    for name, value in metric.compute().items():
        assert float(value) == pytest.approx(getattr(whole, name), abs=1e-4)
        assert value.dtype == torch.float32


def test_no_residuals():
    metric = CovarianceCalibration()
    metric.update(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    assert all(np.isnan(value) for value in metric.compute().values())


@pytest.mark.parametrize(
    ("residual", "covariance", "words"),
    [
        ([[0, 0]], [TRUTH, TRUTH], "must be"),
        ([[np.nan, 0]], [TRUTH], "finite"),
        ([[0, 0]], [-TRUTH], "positive definite"),
        ([[0, 0]], [[[1, 1], [1, 1]]], "positive definite"),
    ],
)
def test_what_is_no_residual_or_covariance(residual, covariance, words):
    with pytest.raises(ValueError, match=words):
        reliability_sums(residual, covariance)


@pytest.mark.parametrize("bins", [-1, 0])
def test_without_bins_there_is_nothing_to_count(bins):
    with pytest.raises(BadInputError, match=f"bins of the covariance is {bins}: give a whole number above 0"):
        CovarianceCalibration(bins)

from dataclasses import replace

import numpy as np
import pytest
from validation_pairs import validate, verified

from sips_lit.callbacks.covariance import CovarianceValidation
from sips_lit.inliers.verification import VerifiedPair
from sips_lit.inliers.verifier import ExactVerifier


def measured(deviation: float, claimed: float, good: int = 30, seed: int = 0) -> VerifiedPair:
    """A pair with residuals of this standard deviation, whose points claim half of the variance ``claimed`` each."""
    pair = verified(good, seed=seed)
    verifier = pair.verifier
    assert isinstance(verifier, ExactVerifier)
    residual = np.random.default_rng(seed).normal(0, deviation, (len(verifier.lifetimes), 2, 2)).astype(np.float32)
    covariance = np.broadcast_to(np.eye(2, dtype=np.float32) * claimed / 2, (30, 2, 2))
    features = [
        replace(f, keypoints=replace(f.keypoints, covariance=covariance)) for f in (pair.features0, pair.features1)
    ]
    inliers = replace(verifier.inliers, residual=residual)
    return replace(pair, features0=features[0], features1=features[1], verifier=replace(verifier, inliers=inliers))


def test_residuals_as_large_as_claimed(shown):
    callback = CovarianceValidation()
    logged = validate(callback, *(measured(0.5, 0.25, seed=seed) for seed in range(20))).logged
    assert logged["val/covariance_scale"] == pytest.approx(1, abs=0.1)
    assert logged["val/covariance_error"] < 0.03
    assert callback.metric.result().residuals == 20 * 2 * 30
    assert [(name, step) for name, step, _ in shown] == [("val/covariance", 12)]


def test_claims_that_are_too_small(shown):
    logged = validate(CovarianceValidation(), *(measured(1.0, 0.25, seed=seed) for seed in range(20))).logged
    assert logged["val/covariance_scale"] == pytest.approx(4, abs=0.4)
    assert logged["val/covariance_error"] > 0.2


def test_only_inliers_count(shown):
    callback = CovarianceValidation()
    validate(callback, measured(0.5, 0.25, good=12))
    assert callback.metric.result().residuals == 2 * 12


def test_points_without_covariances(shown):
    assert np.isnan(validate(CovarianceValidation(), verified(30)).logged["val/covariance_error"])

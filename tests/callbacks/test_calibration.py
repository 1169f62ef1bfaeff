import numpy as np
import pytest
from validation_pairs import N, validate, verified

from sips_lit.callbacks.calibration import CalibrationValidation


def test_calibration_of_known_pairs(shown):
    callback = CalibrationValidation(bins=10)
    pairs = verified(30), verified(0, seed=1)
    logged = validate(callback, *pairs).logged
    scores = np.linspace(0.9, 0.1, N)
    squared = np.concatenate([(scores - 1) ** 2, scores**2])
    assert logged["val/brier"] == pytest.approx(squared.mean(), abs=1e-4)
    assert 0 < logged["val/ece"] <= logged["val/mce"] <= 1
    assert callback.metric.result().points == 4 * N  # both images of both pairs
    assert [(name, step) for name, step, _ in shown] == [("val/reliability", 12)]


def test_errors_of_one_bin_by_hand(shown):
    """All of a pair's 30 points say 0.9 to 0.1, a third are inliers: 0.5 against 1/3 in a single bin."""
    logged = validate(CalibrationValidation(bins=1), verified(10)).logged
    assert logged["val/ece"] == pytest.approx(0.5 - 1 / 3, abs=1e-5)
    assert logged["val/mce"] == pytest.approx(0.5 - 1 / 3, abs=1e-5)


def test_every_validation_starts_anew(shown):
    callback = CalibrationValidation(bins=10)
    scores = np.linspace(0.9, 0.1, N)
    validate(callback, verified(0, seed=1))
    assert validate(callback, verified(30)).logged["val/brier"] == pytest.approx(((scores - 1) ** 2).mean(), abs=1e-4)


def test_pairs_without_any_point(shown):
    assert np.isnan(validate(CalibrationValidation(), verified(0, n=0)).logged["val/ece"])

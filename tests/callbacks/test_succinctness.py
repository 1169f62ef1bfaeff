import numpy as np
import pytest
from validation_pairs import validate, verified

from sips_lit.callbacks.succinctness import SuccinctnessValidation


def test_succinctness_of_known_pairs(shown):
    # the best points are inliers: k of them need k points; the third pair has too few
    logged = validate(SuccinctnessValidation(10, 50), verified(30), verified(10, seed=1), verified(9, seed=2)).logged
    assert logged["val/succinctness_auc"] == pytest.approx(2 / 3 * 40 / 50)
    assert logged["auc"] == pytest.approx(logged["val/succinctness_auc"])  # in the progress bar
    assert logged["val/failure_rate"] == pytest.approx(1 / 3)
    assert logged["val/n_median"] == 10
    assert "val/n_at_80" not in logged  # never reached: no number
    assert [(name, step) for name, step, _ in shown] == [("val/curve", 12)]


def test_n_at_80_where_it_is_reached(shown):
    logged = validate(
        SuccinctnessValidation(7, 50), *[verified(30, seed=seed) for seed in range(4)], verified(0)
    ).logged
    assert logged["val/n_at_80"] == 7


def test_every_validation_starts_anew(shown):
    callback = SuccinctnessValidation(10, 50)
    assert validate(callback, verified(5)).logged["val/failure_rate"] == 1
    assert validate(callback, verified(20)).logged["val/failure_rate"] == 0


def test_pairs_without_any_point_fail(shown):
    logged = validate(SuccinctnessValidation(10, 50), verified(0, n=0)).logged
    assert logged["val/succinctness_auc"] == 0
    assert logged["val/failure_rate"] == 1


def test_no_pairs_have_no_numbers(shown):
    logged = validate(SuccinctnessValidation(10, 50)).logged
    assert np.isnan(logged["val/succinctness_auc"])
    assert "val/n_median" not in logged

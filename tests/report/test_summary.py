from dataclasses import replace

import numpy as np
import pytest
from benchmark_examples import detector_result, pair_table

from sips_lit.evaluate.result import PoseOutcome
from sips_lit.report.summary import (
    at_main_budget,
    error_auc,
    error_curve,
    main_budget,
    main_k,
    needed_points,
    over_repeats,
    without_pose,
)


def test_the_k_and_n_of_the_table_are_the_protocols():
    result = detector_result("SIFT", pair_table(np.random.default_rng(0), 5))
    assert (main_k(result), main_budget(result)) == (10, 50)
    assert main_k(replace(result, protocol={"k": 20})) == 20
    assert main_budget(replace(result, protocol={"n": 100})) == 100
    one = replace(result, ks=(5,), n_k=result.n_k[:, :, :1], protocol={}, budgets={})
    assert (main_k(one), main_budget(one)) == (5, None)


def test_pairs_without_a_pose():
    found, few, unknown = PoseOutcome.FOUND, PoseOutcome.FEW_MATCHES, PoseOutcome.UNKNOWN
    assert without_pose(np.array([[found, few], [few, few], [unknown, unknown]])) == 1.5
    assert np.isnan(without_pose(np.full((3, 2), unknown)))


def test_unknown_errors_are_left_out_and_failures_are_not():
    errors = np.array([[0.25], [np.inf], [np.nan], [2.0]])
    assert error_auc(errors, 1.0) == pytest.approx(0.25)
    x, y = error_curve(errors, 1.0)
    np.testing.assert_allclose(x, [0, 0.25, 1])
    np.testing.assert_allclose(y, [0, 1 / 3, 1 / 3])
    assert error_curve(np.full((3, 1), np.nan), 1.0) is None


def test_the_median_over_repeats_was_measured():
    values = np.array([[3.0, 1, 2], [np.inf, 1, np.inf], [np.nan] * 3])
    np.testing.assert_array_equal(over_repeats(values), [2, np.inf, np.nan])
    np.testing.assert_array_equal(over_repeats(np.array([[4.0, np.inf]])), [4])


def test_what_was_measured_at_the_n_of_the_table():
    table = pair_table(np.random.default_rng(0), 3)
    a, b, c = (detector_result(name, table, seed) for seed, name in enumerate("abc"))
    a = replace(a, protocol={"n": 100})
    found = at_main_budget([a, replace(b, budgets={50: b.budgets[50]}), c])
    assert found == {"a": a.budgets[100], "c": c.budgets[100]}
    assert at_main_budget([]) == {}
    assert at_main_budget([replace(a, protocol={}, budgets={})]) == {}


def test_points_needed_are_those_of_their_k():
    result = detector_result("a", pair_table(np.random.default_rng(0), 3))
    np.testing.assert_array_equal(needed_points(result, 12), result.n_k[..., 5])

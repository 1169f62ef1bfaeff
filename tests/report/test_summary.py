from dataclasses import replace

import numpy as np
import pytest
from benchmark_examples import detector_result, pair_table

from sips_lit.report.columns import columns_of, text_of
from sips_lit.report.summary import error_auc, error_curve, main_budget, main_k, over_repeats, summary


@pytest.fixture(scope="module")
def result():
    return detector_result("SIFT + RootSIFT", pair_table(np.random.default_rng(0), 30), quality=0.3)


def test_succinctness_is_the_mean_over_pairs_and_repeats(result):
    row, n_k = summary(result), result.n_k[:, :, result.ks.index(10)]
    gained = np.clip(1 - n_k / 200, 0, 1)  # a pair counts from n_k on: the integral of a step
    assert row.auc == pytest.approx(gained.mean())
    assert row.auc_deviation == pytest.approx(gained.mean(axis=0).std(ddof=1))
    assert row.failures == pytest.approx(np.isinf(n_k).sum() / 5)
    assert row.mean_needed == pytest.approx(n_k[np.isfinite(n_k)].mean())
    slow = next((n for n in range(201) if np.mean(n_k <= n) >= 0.8), np.inf)
    assert row.n_at_80 == slow


def test_pose_auc_at_fifty_points(result):
    row, at = summary(result), result.budgets[50]
    assert row.n == 50
    assert row.translation == pytest.approx(np.clip(1 - at.translation_error, 0, 1).mean())
    assert row.rotation == pytest.approx(np.clip(1 - at.rotation_error, 0, 1).mean())


def test_limits_of_the_pose_auc_are_the_protocols(result):
    wide = summary(replace(result, protocol={**result.protocol, "rotation_limit": 5.0, "translation_limit": 0.5}))
    assert wide.rotation == pytest.approx(np.clip(1 - result.budgets[50].rotation_error / 5, 0, 1).mean())
    assert wide.translation == pytest.approx(np.clip(1 - 2 * result.budgets[50].translation_error, 0, 1).mean())
    titles = {column.key: column.title for column in columns_of([wide])}
    assert titles["pose_auc_5deg"] == "pose AUC-5° at 50"
    assert titles["pose_auc_0.5m"] == "pose AUC-0.5 m at 50"


def test_a_detector_that_always_fails():
    failed = detector_result("bad + RootSIFT", pair_table(np.random.default_rng(0), 5), quality=-1e9)
    assert np.isinf(failed.n_k).all()
    row = summary(failed)
    assert (row.auc, row.failures, row.translation, row.n_at_80) == (0, 5, 0, np.inf)
    assert np.isnan(row.mean_needed)


def test_unknown_poses_are_undefined_and_have_no_column():
    row = summary(detector_result("SIFT", pair_table(np.random.default_rng(0), 5, poses=False)))
    assert np.isnan([row.translation, row.rotation, row.translation_deviation]).all()
    keys = {column.key for column in columns_of([row])}
    assert "auc" in keys
    assert not keys & {"pose_auc_1m", "pose_auc_1deg", "ece_50"}


def test_one_repeat_has_no_deviation():
    assert np.isnan(summary(detector_result("SIFT", pair_table(np.random.default_rng(0), 5), repeats=1)).auc_deviation)


def test_no_budgets_and_other_ks():
    result = detector_result("SIFT", pair_table(np.random.default_rng(0), 5))
    assert main_budget(replace(result, budgets={})) is None
    assert np.isnan(summary(replace(result, budgets={})).translation)
    assert main_k(replace(result, protocol={"k": 20})) == 20
    one = replace(result, ks=(5,), n_k=result.n_k[:, :, :1])
    assert main_k(one) == 5


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


def test_text():
    assert [text_of(v, 1) for v in (2.25, np.inf, np.nan)] == ["2.2", "never", "-"]

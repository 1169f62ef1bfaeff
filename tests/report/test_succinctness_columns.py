from dataclasses import replace

import numpy as np
import pytest
from benchmark_examples import detector_result, pair_table
from table_rows import Row

from sips_lit.report.columns import auc_of, columns_of


@pytest.fixture(scope="module")
def result():
    return detector_result("SIFT + RootSIFT", pair_table(np.random.default_rng(0), 30), quality=0.3)


def test_succinctness_is_the_mean_over_pairs_and_repeats(result):
    row, n_k = Row(result), result.n_k[:, :, result.ks.index(10)]
    gained = np.clip(1 - n_k / 200, 0, 1)  # a pair counts from n_k on: the integral of a step
    assert row["auc"] == pytest.approx(gained.mean())
    assert auc_of(result) == row["auc"]
    assert row.deviations["auc"] == pytest.approx(gained.mean(axis=0).std(ddof=1))
    assert row["failures"] == pytest.approx(np.isinf(n_k).sum() / 5)
    assert row["mean_n"] == pytest.approx(n_k[np.isfinite(n_k)].mean())
    for key, share in (("n_at_80", 0.8), ("median_n", 0.5)):
        assert row[key] == next((n for n in range(201) if np.mean(n_k <= n) >= share), np.inf)


def test_judged_points_have_columns_where_something_is_unknown(result):
    keys = {"n_at_80_judged", "auc_judged", "unknown"}
    n_k_judged = np.maximum(result.n_k - 7, 10)
    some = replace(result, unknown=np.linspace(0, 0.5, 30), n_k_judged=n_k_judged)
    nobody = replace(result, unknown=np.full(30, np.nan))
    row, needed = Row(some), n_k_judged[:, :, result.ks.index(10)]
    gained = np.clip(1 - needed / 200, 0, 1)
    assert row["auc_judged"] == pytest.approx(gained.mean())
    assert row["auc_judged"] > row["auc"] == auc_of(result)
    assert row.deviations["auc_judged"] == pytest.approx(gained.mean(axis=0).std(ddof=1))
    assert row["n_at_80_judged"] == next(n for n in range(201) if np.mean(needed <= n) >= 0.8)
    assert row["unknown"] == pytest.approx(0.25)
    for methods in ([result], [nobody], [nobody, result]):
        assert not keys & {column.key for column in columns_of(methods)}
    for methods in ([some, result], [result, nobody, some]):  # of all methods, to compare them
        of_all = {column.key: column.value(result) for column in columns_of(methods) if column.key in keys}
        assert of_all == {"n_at_80_judged": Row(result)["n_at_80"], "auc_judged": auc_of(result), "unknown": 0}


def test_a_detector_that_always_fails():
    failed = detector_result("bad + RootSIFT", pair_table(np.random.default_rng(0), 5), quality=-1e9)
    assert np.isinf(failed.n_k).all()
    row = Row(failed)
    assert (row["auc"], row["failures"], row["pose_auc_1m"], row["n_at_80"]) == (0, 5, 0, np.inf)
    assert "mean_n" not in row.values


def test_one_repeat_has_no_deviation():
    row = Row(detector_result("SIFT", pair_table(np.random.default_rng(0), 5), repeats=1))
    assert np.isnan(row.deviations["auc"])

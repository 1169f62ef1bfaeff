from dataclasses import replace

import numpy as np
import pytest
from benchmark_examples import detector_result, pair_table
from table_rows import Row

from sips_lit.report.columns import auc_of, best_first, columns_of, is_scored, text_of


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


def test_pose_auc_at_fifty_points(result):
    row, at = Row(result), result.budgets[50]
    assert row["pose_auc_1m"] == pytest.approx(np.clip(1 - at.translation_error, 0, 1).mean())
    assert row["pose_auc_1deg"] == pytest.approx(np.clip(1 - at.rotation_error, 0, 1).mean())
    by_repeat = np.clip(1 - at.rotation_error, 0, 1).mean(axis=0)
    assert row.deviations["pose_auc_1deg"] == pytest.approx(by_repeat.std(ddof=1))


def test_limits_of_the_pose_auc_are_the_protocols(result):
    wide = replace(result, protocol={**result.protocol, "rotation_limit": 5.0, "translation_limit": 0.5})
    row = Row(wide)
    assert row["pose_auc_5deg"] == pytest.approx(np.clip(1 - result.budgets[50].rotation_error / 5, 0, 1).mean())
    assert row["pose_auc_0.5m"] == pytest.approx(np.clip(1 - 2 * result.budgets[50].translation_error, 0, 1).mean())
    titles = {column.key: column.title for column in columns_of([wide])}
    assert titles["pose_auc_5deg"] == "pose AUC-5° at 50"
    assert titles["pose_auc_0.5m"] == "pose AUC-0.5 m at 50"


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


def test_unknown_poses_are_undefined_and_have_no_column():
    keys = set(Row(detector_result("SIFT", pair_table(np.random.default_rng(0), 5, poses=False))).values)
    assert "auc" in keys
    assert not keys & {"pose_auc_1m", "pose_auc_1deg", "no_pose", "ece_50"}


def test_a_column_stays_where_another_method_has_a_value(result):
    times = replace(result, milliseconds={"detect": 3.0})
    keys = [column.key for column in columns_of([times, replace(result, milliseconds={"match": 4.0})])]
    assert [key for key in keys if key.endswith("_ms")] == ["detect_ms", "match_ms"]
    by_key = {column.key: column for column in columns_of([times, result])}
    assert np.isnan(by_key["verify_ms"].value(times))
    assert by_key["detect_ms"].value(times) == 3.0


def test_one_repeat_has_no_deviation():
    row = Row(detector_result("SIFT", pair_table(np.random.default_rng(0), 5), repeats=1))
    assert np.isnan(row.deviations["auc"])


def test_no_budgets():
    result = detector_result("SIFT", pair_table(np.random.default_rng(0), 5))
    keys = {column.key for column in columns_of([replace(result, budgets={})])}
    assert "auc" in keys
    assert not keys & {"pose_auc_1m", "repeatability", "matching_score", "spread"}


def test_the_order_is_by_auc():
    table = pair_table(np.random.default_rng(0), 9)
    results = [detector_result(name, table, quality=q) for name, q in (("a", 0.2), ("b", 0.9), ("c", 0.5))]
    assert [method.name for method in best_first(results)] == ["b", "c", "a"]


def test_points_with_and_without_an_order(result):
    assert is_scored(result)
    assert not is_scored(replace(result, protocol={"scores": "none"}))


def test_no_methods():
    assert columns_of([]) == []


def test_text():
    assert [text_of(v, 1) for v in (2.25, np.inf, np.nan)] == ["2.2", "never", "-"]


def test_counts_have_decimals_only_where_they_must(result):
    texts = {column.key: [column.text(value) for value in (4.0, 4.5, np.inf)] for column in columns_of([result])}
    assert texts["failures"] == texts["no_pose"] == ["4", "4.5", "never"]
    assert texts["mean_n"] == ["4.0", "4.5", "never"]
    assert texts["auc"] == ["4.000", "4.500", "never"]

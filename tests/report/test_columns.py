from dataclasses import replace

import numpy as np
import pytest
from benchmark_examples import detector_result, pair_table
from table_rows import Row

from sips_lit.report.columns import best_first, columns_of, is_scored


@pytest.fixture(scope="module")
def result():
    return detector_result("SIFT + RootSIFT", pair_table(np.random.default_rng(0), 30), quality=0.3)


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

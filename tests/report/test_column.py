import numpy as np
import pytest
from benchmark_examples import detector_result, pair_table

from sips_lit.report.column import text_of
from sips_lit.report.columns import columns_of


@pytest.fixture(scope="module")
def result():
    return detector_result("SIFT + RootSIFT", pair_table(np.random.default_rng(0), 30), quality=0.3)


def test_text():
    assert [text_of(v, 1) for v in (2.25, np.inf, np.nan)] == ["2.2", "never", "-"]


def test_counts_have_decimals_only_where_they_must(result):
    texts = {column.key: [column.text(value) for value in (4.0, 4.5, np.inf)] for column in columns_of([result])}
    assert texts["failures"] == texts["no_pose"] == ["4", "4.5", "never"]
    assert texts["mean_n"] == ["4.0", "4.5", "never"]
    assert texts["auc"] == ["4.000", "4.500", "never"]

import math
from dataclasses import replace

import numpy as np
import pytest
from benchmark_examples import NAMES, detector_result, pair_set, pair_table

from sips_lit.evaluate.result import PairSetResult
from sips_lit.metrics.bootstrap import draw_pairs
from sips_lit.report.columns import auc_of, columns_of
from sips_lit.report.intervals import Estimate, best_value, intervals


def of_names(*names: str, sequences: int = 1, pairs: int = 24) -> PairSetResult:
    """Methods whose n_k are alike but for 1 point each after the first, on 24 pairs."""
    table = pair_table(np.random.default_rng(0), pairs)
    table = replace(table, name=tuple(f"s{index % sequences}:{index}-{index + 1}" for index in range(pairs)))
    first = detector_result(names[0], table, quality=0.6, repeats=2)
    methods = tuple(
        replace(first, name=name, key=name, n_k=first.n_k + rank, protocol=first.protocol | {"detector": name})
        for rank, name in enumerate(names)
    )
    return PairSetResult("set", "Set", {}, methods, {})


def test_each_draw_is_what_the_column_says_of_those_pairs():
    """The numbers of draws against the column of a result that has the drawn pairs one by one."""
    result = pair_set(NAMES[:1], 9, repeats=2)
    method = result.detectors[0]
    drawn = draw_pairs(method.pairs.sequences, 6, 3)
    for column in columns_of(result.detectors):
        if column.resampled is None:
            continue
        for row, value in zip(drawn, column.resampled(method, drawn), strict=True):
            taken = np.repeat(np.arange(9), row)
            budgets = {
                n: replace(at, rotation_error=at.rotation_error[taken], translation_error=at.translation_error[taken])
                for n, at in method.budgets.items()
            }
            again = replace(method, n_k=method.n_k[taken], n_k_judged=method.n_k_judged[taken], budgets=budgets)
            assert value == pytest.approx(column.value(again)), column.key


def test_numbers_with_an_interval():
    result = pair_set(NAMES[:3], 30, repeats=2)
    found = intervals(result, 200)
    keys = {"n_at_80", "auc", "pose_auc_1m", "pose_auc_1deg"}
    assert {column for _, column in found.of} == keys
    for column in columns_of(result.detectors):
        for method in result.detectors if column.key in keys else ():
            estimate, value = found.of[method.key, column.key], column.value(method)
            assert estimate.low <= value <= estimate.high
            if not math.isnan(estimate.difference):
                assert estimate.difference_low <= estimate.difference <= estimate.difference_high
    best = max(result.detectors, key=auc_of)
    assert math.isnan(found.of[best.key, "auc"].difference)
    assert not found.of[best.key, "auc"].tied


def test_the_difference_is_paired():
    """One point more on each pair is a difference for sure, however much the pairs differ from each other."""
    found = intervals(of_names("a", "b"), 300).of
    a, b = found["a", "auc"], found["b", "auc"]
    assert a.low < b.high  # by themselves they overlap
    assert (b.difference, b.difference_low, b.difference_high) == pytest.approx((-1 / 200,) * 3)
    assert not b.tied


def test_a_twin_can_not_be_told_from_the_best():
    result = of_names("a", "b", "c")
    twin = replace(result.detectors[2], n_k=result.detectors[0].n_k[::-1])  # the same numbers, of other pairs
    found = intervals(replace(result, detectors=(*result.detectors[:2], twin)), 300).of
    assert found["c", "auc"].difference == 0
    assert found["c", "auc"].tied


def test_a_control_is_compared_and_never_the_best():
    result = of_names("random", "a", "b")
    found = intervals(result, 100).of
    assert found["random", "auc"].difference > 0
    assert math.isnan(found["a", "auc"].difference)


@pytest.mark.parametrize(
    ("sequences", "over"), [(1, "the pairs"), (3, "the pairs of each of the 3 sequences"), (12, "the 12 sequences")]
)
def test_what_is_drawn(sequences, over):
    assert intervals(of_names("a", sequences=sequences), 10).over == over


def test_intervals_of_few_sequences_with_a_pair_each_have_a_width():
    found = intervals(of_names("a", sequences=6, pairs=6), 200)
    assert found.over == "the 6 sequences"
    assert found.of["a", "auc"].low < found.of["a", "auc"].high


def test_nothing_to_draw():
    assert intervals(of_names("a"), 0).of == {}
    assert intervals(PairSetResult("e", "empty", {}, (), {}), 10).of == {}
    assert intervals(pair_set(NAMES[:1], 0), 10).of == {}


def test_a_single_pair_tells_no_spread():
    assert not intervals(pair_set(NAMES[:2], 1), 100).of
    assert intervals(pair_set(NAMES[:2], 2), 100).of


def test_one_method_has_no_difference_but_an_interval():
    found = intervals(of_names("a"), 50).of
    assert math.isnan(found["a", "auc"].difference)
    assert found["a", "auc"].low < found["a", "auc"].high


def test_the_best_value():
    result = of_names("a", "b")
    auc = next(column for column in columns_of(result.detectors) if column.key == "auc")
    assert best_value(auc, result.detectors) == auc.value(result.detectors[0])
    assert best_value(auc, result.detectors[:1]) is None
    assert best_value(auc, (result.detectors[0], replace(result.detectors[0], name="twin"))) is None
    assert not Estimate(0, 1).tied

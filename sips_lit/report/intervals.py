"""How sure the numbers of a table are: an interval of each, and whether a method can be told from the best.

The best of a column is the best as measured: of methods that are about equal it is the luckiest, which makes the distances
of the others look somewhat larger than they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from sips_lit.evaluate.result import FloatArray, IntArray, MethodResult, PairSetResult
from sips_lit.metrics.bootstrap import difference, draw_pairs, draws_groups, interval
from sips_lit.report.column import Column
from sips_lit.report.columns import best_first, columns_of
from sips_lit.report.labels import is_control


@dataclass(frozen=True, slots=True)
class Estimate:
    """The 95 % interval of a number, from ``low`` to ``high``, and of its ``difference`` to the best, NaN without one."""

    low: float
    high: float
    difference: float = math.nan
    difference_low: float = math.nan
    difference_high: float = math.nan

    @property
    def says(self) -> bool:
        """Whether the interval tells more than the number: not where no draw ever gets there."""
        return math.isfinite(self.low)

    @property
    def tied(self) -> bool:
        """Whether the method can't be told from the best: there may be no difference."""
        return self.difference_low <= 0 <= self.difference_high


@dataclass(frozen=True, slots=True)
class Intervals:
    """Estimates of a pair set by the keys of method and column; ``over``: what was drawn, ``resamples`` times."""

    resamples: int = 0
    over: str = ""
    of: Mapping[tuple[str, str], Estimate] = field(default_factory=dict)


def intervals(result: PairSetResult, resamples: int, seed: int = 0) -> Intervals:
    """Estimates of all numbers that can be resampled; none of one pair, which tells no spread, or of no ``resamples``."""
    methods = result.detectors
    if not methods or len(methods[0].pairs) < 2 or resamples < 1:
        return Intervals()
    groups = methods[0].pairs.sequences
    drawn = draw_pairs(groups, resamples, seed)
    found: dict[tuple[str, str], Estimate] = {}
    for column in columns_of(methods):
        if column.resampled is not None:
            found |= {(key, column.key): estimate for key, estimate in _estimates(column, methods, drawn).items()}
    return Intervals(resamples, _drawn(groups), found)


def best_value(column: Column, methods: Sequence[MethodResult]) -> float | None:
    """The best value of a column, controls left aside.

    None where nothing is to be marked: fewer than two methods have one, none is finite, or all are shown alike.
    """
    values = [value for method in methods if not is_control(method) and not math.isnan(value := column.value(method))]
    if column.better == 0 or len({column.text(value) for value in values}) < 2:
        return None
    return max(values) if column.better > 0 else min(values)


def _estimates(column: Column, methods: Sequence[MethodResult], drawn: IntArray) -> dict[str, Estimate]:
    assert column.resampled is not None
    samples = {method.key: column.resampled(method, drawn) for method in methods}
    best = best_value(column, methods)
    first = next((m for m in best_first(methods) if not is_control(m) and column.value(m) == best), None)
    found = {}
    for method in methods:
        of_method = samples[method.key]
        value = column.value(method)
        if math.isnan(value):
            continue
        if first is None or method is first:
            found[method.key] = Estimate(*interval(of_method))
        else:
            apart = value - column.value(first)
            between = _difference(of_method, samples[first.key])
            found[method.key] = Estimate(*interval(of_method), apart, *between)
    return found


def _difference(samples: FloatArray, best: FloatArray) -> tuple[float, float]:
    return interval(difference(samples, best))


def _drawn(groups: Sequence[str]) -> str:
    count = len(set(groups))
    if count == 1:
        return "the pairs"
    whole = draws_groups(groups) or count == len(groups)
    return f"the {count} sequences" if whole else f"the pairs of each of the {count} sequences"

"""The cells of a pair set's table on the page, and what they are sorted by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sips_lit.evaluate.result import MethodResult
from sips_lit.render.styles import is_control
from sips_lit.report.columns import OWN_N, Column, best_first, is_scored


@dataclass(frozen=True, slots=True)
class Cell:
    """``text`` is shown, with the ``deviation`` over the repeats, if any; rows are sorted by ``key``, empty ones last."""

    text: str
    key: str
    deviation: str
    best: bool


@dataclass(frozen=True, slots=True)
class Row:
    """A method by name, with a cell for each column; ``tags`` say what is special about it."""

    name: str
    control: bool
    tags: tuple[str, ...]
    cells: tuple[Cell, ...]


def table_rows(methods: Sequence[MethodResult], columns: Sequence[Column]) -> list[Row]:
    """A row for each method, best AUC first. The best of several values is marked in each column, controls left aside."""
    rivals = [method for method in methods if not is_control(method.name)]
    best = [_best(column, rivals) for column in columns]
    rows = []
    for method in best_first(methods):
        control = is_control(method.name)
        tags = ("control",) * control + (OWN_N,) * (not is_scored(method))
        cells = [_cell(column, method, "" if control else text) for column, text in zip(columns, best, strict=True)]
        rows.append(Row(method.name, control, tags, tuple(cells)))
    return rows


def _cell(column: Column, method: MethodResult, best: str) -> Cell:
    value, deviation = column.value(method), math.nan if column.deviation is None else column.deviation(method)
    key = "" if math.isnan(value) else "Infinity" if math.isinf(value) else repr(float(value))
    text = column.text(value)
    return Cell(text, key, "" if math.isnan(deviation) else f"± {deviation:.3f}", math.isfinite(value) and text == best)


def _best(column: Column, methods: Sequence[MethodResult]) -> str:
    """The best value as it is shown; empty where there is nothing to choose."""
    values = [value for method in methods if not math.isnan(value := column.value(method))]
    if len(methods) < 2 or not values or column.better == 0:
        return ""
    return column.text(max(values) if column.better > 0 else min(values))

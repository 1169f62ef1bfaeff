"""The report as one page of HTML that needs nothing else: no network, no other file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined

from sips_lit.evaluate.result import MethodResult, PairSetResult
from sips_lit.report.column import Column
from sips_lit.report.columns import OWN_N, best_first, columns_of, is_scored
from sips_lit.report.counts import counts
from sips_lit.report.embedding import inline_svg, picture_uri
from sips_lit.report.facts import facts, pair_statistics
from sips_lit.report.figures import Styles, charts
from sips_lit.report.intervals import Estimate, Intervals, best_value
from sips_lit.report.labels import is_control
from sips_lit.report.pair_pictures import PairPicture
from sips_lit.report.protocol import protocol_differences, protocol_rows, protocol_sentences, shared_protocol

PairPictures = Mapping[tuple[str, str], Sequence[PairPicture]]
"""By the keys of pair set and method."""
_TEMPLATES: Final = Environment(
    loader=PackageLoader("sips_lit.report"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


@dataclass(frozen=True, slots=True)
class Cell:
    """``text`` is shown, with the ``deviation`` over the repeats and the ``interval``, if any.

    Rows are sorted by ``key``, empty ones last. ``tied``: not the ``best``, and not to be told from it.
    """

    text: str
    key: str
    deviation: str
    best: bool
    interval: str = ""
    tied: bool = False


@dataclass(frozen=True, slots=True)
class Row:
    """A method by name, with a cell for each column; ``tags`` say what is special about it."""

    name: str
    control: bool
    tags: tuple[str, ...]
    cells: tuple[Cell, ...]


def report_page(
    results: Sequence[PairSetResult],
    pictures: PairPictures,
    styles: Styles,
    date: str | None,
    machine: Mapping[str, str],
    intervals: Mapping[str, Intervals] | None = None,
    notes: Sequence[str] = (),
) -> str:
    """The whole page; every text from outside is escaped. ``intervals`` by the keys of the pair sets.

    ``notes``: sentences for its head. Raises BadInputError when a picture cannot be read.
    """
    known = intervals or {}
    columns = [column for result in results for column in columns_of(result.detectors)]
    return _TEMPLATES.get_template("page.html.j2").render(
        date=date,
        notes=notes,
        machine=protocol_rows(machine),
        sections=[
            _section(index, result, pictures, styles, known.get(result.key, Intervals()))
            for index, result in enumerate(results)
        ],
        styles=styles,
        definitions=dict.fromkeys((column.title, column.definition) for column in columns),
        own_n=OWN_N,
    )


def _section(
    index: int, result: PairSetResult, pictures: PairPictures, styles: Styles, intervals: Intervals
) -> dict[str, Any]:
    """What the template shows of a pair set, as plain values."""
    methods, columns = result.detectors, columns_of(result.detectors)
    return {
        "title": result.title,
        "pairs": len(methods[0].pairs) if methods else 0,
        "facts": facts(result),
        "pair_statistics": pair_statistics(methods[0].pairs) if methods else ([], {}),
        "columns": columns,
        "rows": table_rows(methods, columns, intervals),
        "intervals": intervals,
        "to_best": differences_to_best(methods, columns, intervals),
        "skipped": result.skipped,
        "charts": [
            (chart, inline_svg(chart.figure, f"set-{index}-{chart.key}", chart.title))
            for chart in charts(result, styles, legend=False)
        ],
        "pictures": {
            method.name: [(picture, picture_uri(picture.image)) for picture in drawn]
            for method in methods
            if (drawn := pictures.get((result.key, method.key)))
        },
        "counts": counts(result),
        "protocol": protocol_sentences(result),
        "protocol_rows": protocol_rows(shared_protocol(result)),
        "differences": protocol_differences(result),
    }


def table_rows(
    methods: Sequence[MethodResult], columns: Sequence[Column], intervals: Intervals | None = None
) -> list[Row]:
    """A row for each method, best AUC first. The best of several values is marked in each column, controls left aside."""
    estimates = {} if intervals is None else intervals.of
    best = [_best(column, methods) for column in columns]
    rows = []
    for method in best_first(methods):
        control = is_control(method)
        tags = ("control",) * control + (OWN_N,) * (not is_scored(method))
        cells = [
            _cell(column, method, "" if control else text, estimates.get((method.key, column.key)))
            for column, text in zip(columns, best, strict=True)
        ]
        rows.append(Row(method.name, control, tags, tuple(cells)))
    return rows


def differences_to_best(
    methods: Sequence[MethodResult], columns: Sequence[Column], intervals: Intervals
) -> tuple[list[str], dict[str, list[str]]]:
    """Titles of the columns with intervals, and by the names of the methods their differences to the best; or nothing."""
    compared = [
        column
        for column in columns
        if any(not math.isnan(intervals.of[key].difference) for key in intervals.of if key[1] == column.key)
    ]
    rows = {}
    for method in best_first(methods) if compared else ():
        found = [intervals.of.get((method.key, column.key)) for column in compared]
        rows[method.name] = [_apart(column, one) for column, one in zip(compared, found, strict=True)]
    return [column.title for column in compared], rows


def _apart(column: Column, estimate: Estimate | None) -> str:
    if estimate is None:
        return "-"
    if math.isnan(estimate.difference):
        return "best"
    if math.isinf(estimate.difference) and math.isinf(estimate.difference_low):
        return "never"
    numbers = (estimate.difference, estimate.difference_low, estimate.difference_high)
    value, low, high = (f"{number:+.{column.digits}f}" if math.isfinite(number) else "never" for number in numbers)
    return f"{value} [{low}, {high}]" + (" ≈" if estimate.tied else "")


def _cell(column: Column, method: MethodResult, best: str, estimate: Estimate | None) -> Cell:
    value, deviation = column.value(method), math.nan if column.deviation is None else column.deviation(method)
    key = "" if math.isnan(value) else "Infinity" if math.isinf(value) else repr(float(value))
    text, spread = column.text(value), "" if math.isnan(deviation) else f"± {deviation:.3f}"
    is_best = math.isfinite(value) and text == best
    if estimate is None:
        return Cell(text, key, spread, is_best)
    tied = estimate.tied and not is_best and not is_control(method)
    between = f"{column.text(estimate.low)} to {column.text(estimate.high)}" if estimate.says else ""
    return Cell(text, key, spread, is_best, between, tied)


def _best(column: Column, methods: Sequence[MethodResult]) -> str:
    """The best value as it is shown; empty where there is nothing to choose."""
    best = best_value(column, methods)
    return "" if best is None else column.text(best)

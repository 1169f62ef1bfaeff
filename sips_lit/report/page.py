"""The report as one page of HTML that needs nothing else: no network, no other file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined

from sips_lit.evaluate.result import MethodResult, PairSetResult
from sips_lit.render.styles import is_control
from sips_lit.report.columns import OWN_N, Column, best_first, columns_of, is_scored
from sips_lit.report.counts import counts
from sips_lit.report.embedding import inline_svg, picture_uri
from sips_lit.report.figures import Styles, charts
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


def report_page(
    results: Sequence[PairSetResult],
    pictures: PairPictures,
    styles: Styles,
    date: str | None,
    machine: Mapping[str, str],
) -> str:
    """The whole page; every text from outside is escaped. Raises BadInputError when a picture cannot be read."""
    columns = [column for result in results for column in columns_of(result.detectors)]
    return _TEMPLATES.get_template("page.html.j2").render(
        date=date,
        machine=protocol_rows(machine),
        sections=[_section(index, result, pictures, styles) for index, result in enumerate(results)],
        styles=styles,
        definitions=dict.fromkeys((column.title, column.definition) for column in columns),
        own_n=OWN_N,
    )


def _section(index: int, result: PairSetResult, pictures: PairPictures, styles: Styles) -> dict[str, Any]:
    """What the template shows of a pair set, as plain values."""
    methods, columns = result.detectors, columns_of(result.detectors)
    return {
        "title": result.title,
        "pairs": len(methods[0].pairs) if methods else 0,
        "columns": columns,
        "rows": table_rows(methods, columns),
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

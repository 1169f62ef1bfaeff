"""The table of a pair set as HTML that can be sorted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

from sips_lit.evaluate.result import MethodResult, PairSetResult
from sips_lit.render.styles import Style, is_control
from sips_lit.report.columns import OWN_N, Column, best_first, columns_of, is_scored, text_of
from sips_lit.report.figures import Styles

_DASHES = {"-": "", "--": "6 3", ":": "1.5 2.5"}


def table_html(result: PairSetResult, styles: Styles) -> str:
    """A row a detector, best AUC first; the best value of each column is marked, controls left aside."""
    rows = best_first(result.detectors)
    columns = columns_of(rows)
    methods = [row for row in rows if not is_control(row.name)]
    best = [_best(column, methods) for column in columns]
    body = "\n".join(_row(row, columns, best, styles[row.name]) for row in rows)
    return (
        '<div class="scroll"><table class="sortable">\n'
        f"<thead><tr>{_heading('detector', 'ascending')}{''.join(map(_column_heading, columns))}</tr></thead>\n"
        f"<tbody>\n{body}\n</tbody></table></div>"
    )


def swatch(style: Style) -> str:
    """A piece of a detector's line."""
    marker = f'<circle cx="16" cy="5" r="3" fill="{style.colour}"/>' if style.marker else ""
    line = f'<path d="M0 5H32" stroke="{style.colour}" stroke-width="2.5" stroke-dasharray="{_DASHES[style.line]}"/>'
    return f'<svg class="swatch" viewBox="0 0 32 10" aria-hidden="true">{line}{marker}</svg>'


def _column_heading(column: Column) -> str:
    first = "descending" if column.better > 0 else "ascending"
    sort = "descending" if column.key == "auc" else None
    return _heading(column.title, first, sort, column.definition)


def _heading(title: str, first: str, sort: str | None = None, definition: str = "") -> str:
    sorted_by = "" if sort is None else f' aria-sort="{sort}"'
    tip = f' title="{escape(definition)}"' if definition else ""
    return f'<th scope="col" data-first="{first}"{sorted_by}{tip}><button type="button">{escape(title)}</button></th>'


def _row(row: MethodResult, columns: Sequence[Column], best: Sequence[float], style: Style) -> str:
    name, control = row.name, is_control(row.name)
    words = ["control"] * control + [OWN_N] * (not is_scored(row))
    tags = "".join(f' <span class="tag">{word}</span>' for word in words)
    cells = [f'<td data-value="{escape(name)}">{swatch(style)}{escape(name)}{tags}</td>']
    cells += [_cell(column, row, record, control) for column, record in zip(columns, best, strict=True)]
    return f"<tr{' class=control' if control else ''}>{''.join(cells)}</tr>"


def _cell(column: Column, row: MethodResult, record: float, control: bool) -> str:
    value = column.value(row)
    sortable = "" if math.isnan(value) else "Infinity" if math.isinf(value) else repr(float(value))
    marked = not control and text_of(value, column.digits) == text_of(record, column.digits) and math.isfinite(value)
    counts = column.key in ("failures", "no_pose") and math.isfinite(value)
    digits = 0 if counts and value == int(value) else column.digits
    deviation = math.nan if column.deviation is None else column.deviation(row)
    spread = "" if math.isnan(deviation) else f' <span class="deviation">± {deviation:.3f}</span>'
    return f'<td data-value="{sortable}"{" class=best" if marked else ""}>{text_of(value, digits)}{spread}</td>'


def _best(column: Column, rows: Sequence[MethodResult]) -> float:
    values = [value for row in rows if not math.isnan(value := column.value(row))]
    if not values or column.better == 0:
        return math.nan
    return max(values) if column.better > 0 else min(values)

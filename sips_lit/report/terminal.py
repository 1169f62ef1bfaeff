"""A pair set in the terminal: its methods, best first, in as many columns as fit, and how the numbers were obtained."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from tabulate import tabulate

from sips_lit.evaluate.result import MethodResult, PairSetResult
from sips_lit.report.column import Column
from sips_lit.report.columns import OWN_N, best_first, columns_of, is_scored
from sips_lit.report.intervals import Intervals
from sips_lit.report.summary import apart, main_k

WIDTH: Final = 100
"""Characters of a line, at most."""
_FIRST: Final = ("n_at_80", "auc", "failures", "pose_auc_", "median_n", "repeatability", "ece_")
"""Columns that are shown before others; those that begin so, where a name ends in _."""
_WITH_INTERVAL: Final = ("n_at_80", "auc")
_NAME, _TITLE = 34, 9  # characters of a method's name and of a title, where lines break


def summary(result: PairSetResult, intervals: Intervals, rest: Path) -> str:
    """The title, the table, what it leaves out, which is in the file ``rest``, and the protocol, no line over `WIDTH`.

    A path, and a name without spaces, may be longer.
    """
    shown, hidden = fitting_columns(result.detectors, intervals)
    parts = [result.title, table(result, intervals, shown)]
    notes = [f"In brackets: 95 % intervals, from {intervals.resamples} draws of {intervals.over}."] * bool(intervals.of)
    if hidden:
        titles = dict.fromkeys("times" if is_time(column) else column.title for column in hidden)
        notes.append(f"Left out here: {', '.join(titles)}. All columns: {rest}")
    parts += ["\n".join(map(_wrapped, notes)), _wrapped(protocol_line(result))]
    return "\n\n".join(part for part in parts if part)


def table(result: PairSetResult, intervals: Intervals, columns: Sequence[Column]) -> str:
    """The methods of a pair set by AUC, with these columns."""
    methods = best_first(result.detectors)
    heads = ["method", *(_wrapped(column.title, _TITLE) for column in columns)]
    rows = [
        [_wrapped(name_of(method), _NAME), *(_cell(column, method, intervals) for column in columns)]
        for method in methods
    ]
    widths = [max(map(_widest, cells)) for cells in zip(heads, *rows, strict=True)]
    lines = [*_lines(heads, widths), "  ".join("-" * width for width in widths)]
    return "\n".join([*lines, *(line for row in rows for line in _lines(row, widths))])


def fitting_columns(methods: Sequence[MethodResult], intervals: Intervals) -> tuple[list[Column], list[Column]]:
    """The columns that fit `WIDTH`, the most telling first to be taken, and those that don't; times never do."""
    columns = columns_of(methods)
    width = max([_widest(_wrapped(name_of(method), _NAME)) for method in methods], default=0)
    taken = []
    for column in sorted(columns, key=_rank):
        cells = [_wrapped(column.title, _TITLE), *(_cell(column, method, intervals) for method in methods)]
        more = 2 + max(map(_widest, cells))
        if not is_time(column) and width + more <= WIDTH:
            width += more
            taken.append(column)
    return [column for column in columns if column in taken], [column for column in columns if column not in taken]


def is_time(column: Column) -> bool:
    """Whether it is the time of a stage."""
    return column.key.endswith("_ms")


def name_of(method: MethodResult) -> str:
    """The name, marked where points have no order."""
    return method.name if is_scored(method) else f"{method.name} ({OWN_N})"


def markdown(result: PairSetResult) -> str:
    """All columns of the methods of a pair set, best first, as a table in Markdown."""
    columns = columns_of(result.detectors)
    rows = [
        [name_of(method).replace("|", r"\|"), *(column.text(column.value(method)) for column in columns)]
        for method in best_first(result.detectors)
    ]
    headers, alignment = ["method", *(column.title for column in columns)], ("left", *["right"] * len(columns))
    return str(tabulate(rows, headers=headers, tablefmt="pipe", disable_numparse=True, colalign=alignment))


def protocol_line(result: PairSetResult) -> str:
    """One line that says how the numbers were obtained; details within details are in the JSON."""
    p, first = result.protocol, next(iter(result.detectors), None)
    parts = [] if first is None else [f"k = {main_k(first)}", f"at most {first.n_max} points"]
    chosen = ", ".join(
        f"{key}={p[key]}" for key in ("kind", "overlap", "overlap_below", "seed", "pairs_file") if key in p
    )
    parts.append(f"{p['pairs']} pair{'' if p['pairs'] == 1 else 's'}" + (f" ({chosen})" if chosen else ""))
    if first is not None and "search" in first.protocol:
        parts.append(f"{first.protocol['search']} search")
    for check in p["verification"]:
        parts.append(", ".join(f"{key}={value}" for key, value in check.items() if not isinstance(value, Mapping)))
    if poses := p.get("refined_poses"):
        agree = f"{poses['agree_given']} of the tracks agree with the given poses, {poses['agree_refined']} with these"
        parts.append(f"poses of {poses['pairs']} pairs refined on tracks ({agree})")
    if first is not None and apart(first.pairs):
        parts.append(f"{apart(first.pairs)} apart (median)")
    return ", ".join(parts)


def _cell(column: Column, method: MethodResult, intervals: Intervals) -> str:
    text, estimate = column.text(column.value(method)), intervals.of.get((method.key, column.key))
    if estimate is None or not estimate.says or column.key not in _WITH_INTERVAL:
        return text
    return f"{text} [{column.text(estimate.low)}, {column.text(estimate.high)}]"


def _rank(column: Column) -> int:
    key = column.key
    first = (at for at, name in enumerate(_FIRST) if key == name or (name.endswith("_") and key.startswith(name)))
    return next(first, len(_FIRST))


def _lines(cells: Sequence[str], widths: Sequence[int]) -> list[str]:
    """A row of the table, whose cells may have several lines: the first cell to the left, the others to the right."""
    split = [cell.splitlines() for cell in cells]
    lines = []
    for at in range(max(map(len, split))):
        texts = [cell[at] if at < len(cell) else "" for cell in split]
        first, *others = zip(texts, widths, strict=True)
        line = [f"{first[0]:<{first[1]}}", *(f"{text:>{width}}" for text, width in others)]
        lines.append("  ".join(line).rstrip())
    return lines


def _wrapped(text: str, width: int = WIDTH) -> str:
    return "\n".join(textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False))


def _widest(text: str) -> int:
    return max(map(len, text.splitlines()), default=0)

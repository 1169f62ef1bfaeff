"""A pair set in the terminal: a table of its detectors, best first, and a line that says how the numbers were obtained."""

from __future__ import annotations

from collections.abc import Mapping

from tabulate import tabulate

from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.columns import OWN_N, columns_of, text_of
from sips_lit.report.summary import summary


def table(result: PairSetResult) -> str:
    """The detectors of a pair set by AUC, as Markdown, without the times."""
    summaries = [(detector.name, summary(detector)) for detector in result.detectors]
    columns = [column for column in columns_of([s for _, s in summaries]) if not column.key.endswith("_ms")]
    rows = [
        [name if s.scored else f"{name} ({OWN_N})", *(text_of(column.value(s), column.digits) for column in columns)]
        for name, s in sorted(summaries, key=lambda named: -named[1].auc)
    ]
    headers = ["detector", *(column.title for column in columns)]
    alignment = ("left", *["right"] * len(columns))
    # numbers are texts: tabulate would cut their trailing zeros
    return str(tabulate(rows, headers=headers, tablefmt="pipe", disable_numparse=True, colalign=alignment))


def protocol_line(result: PairSetResult, measures: Measures) -> str:
    """One line that says how the numbers were obtained."""
    p = result.protocol
    checks = "; ".join(
        ", ".join(f"{key}={value}" for key, value in check.items() if not isinstance(value, Mapping))
        for check in p["verification"]
    )
    chosen = ", ".join(f"{key}={p[key]}" for key in ("kind", "overlap", "seed", "pairs_file") if key in p)
    return f"{p['pairs']} pairs ({chosen}), at most {measures.n_max} points, {checks}"

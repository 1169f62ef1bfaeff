"""A pair set in the terminal: a table of its methods, best first, and a line that says how the numbers were obtained."""

from __future__ import annotations

from collections.abc import Mapping

from tabulate import tabulate

from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.columns import OWN_N, best_first, columns_of, is_scored
from sips_lit.report.summary import apart, main_k


def table(result: PairSetResult) -> str:
    """The methods of a pair set by AUC, as Markdown, without the times."""
    columns = [column for column in columns_of(result.detectors) if not column.key.endswith("_ms")]
    rows = [
        [
            method.name if is_scored(method) else f"{method.name} ({OWN_N})",
            *(column.text(column.value(method)) for column in columns),
        ]
        for method in best_first(result.detectors)
    ]
    headers = ["method", *(column.title for column in columns)]
    alignment = ("left", *["right"] * len(columns))
    # numbers are texts: tabulate would cut their trailing zeros
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

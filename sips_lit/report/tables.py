"""CSV files: a row per method, and a row per pair."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from sips_lit.evaluate.result import MethodResult, PairSetResult
from sips_lit.files import make_folder, safe_name, write_csv, write_whole
from sips_lit.report.columns import columns_of
from sips_lit.report.intervals import Intervals
from sips_lit.report.summary import main_budget, main_k, median_needed, over_repeats
from sips_lit.report.terminal import markdown

Columns = dict[str, Iterable[Any]]
"""Cells of each row by the column's name."""
_ESTIMATED: Final = ("low", "high", "difference", "difference_low", "difference_high")
_HEADER: Final = ("pair_set", "detector", "name", "pairs", "k", "n_max", "n")


def write_tables(
    folder: Path, results: Sequence[PairSetResult], intervals: Mapping[str, Intervals] | None = None
) -> list[Path]:
    """Writes ``summary.csv`` and, per pair set and method, ``<set>/<key>_pairs.csv`` and ``<set>/<key>_all.csv``.

    Beside the first is ``summary.md``, for reading. ``intervals`` by the keys of the pair sets. A failure is ``inf``, what
    is undefined ``nan``. Raises BadInputError when a file cannot be written.
    """
    written = [_write(folder / "summary.csv", summary_rows(results, intervals)), folder / "summary.md"]
    text = "\n\n".join(f"## {result.title}\n\n{markdown(result)}" for result in results)
    write_whole(written[-1], f"{text}\n".encode())
    for result in results:
        subfolder = folder / safe_name(result.key)
        if result.detectors:
            make_folder(subfolder)
        for method in result.detectors:
            known = all_columns(method)
            for kind, columns in (("pairs", paper_columns(method, known)), ("all", known)):
                rows = [columns, *zip(*columns.values(), strict=True)]
                written.append(_write(subfolder / f"{safe_name(method.key)}_{kind}.csv", rows))
    return written


def summary_rows(results: Sequence[PairSetResult], intervals: Mapping[str, Intervals] | None = None) -> list[list[Any]]:
    """The header and a row for each method on each pair set, unrounded; None where the set lacks a column.

    Beside a number stand its deviation over the repeats, its interval, and that of its difference to the best, if any.
    """
    known = intervals or {}
    rows: list[dict[str, Any]] = []
    for result in results:
        columns, estimates = columns_of(result.detectors), known.get(result.key, Intervals()).of
        for method in result.detectors:
            row = {"pair_set": result.key, "detector": method.key, "name": method.name, "pairs": len(method.pairs)}
            row |= {"k": main_k(method), "n_max": method.n_max, "n": main_budget(method)}
            for column in columns:
                row[column.key] = column.value(method)
                if column.deviation is not None:
                    row[f"{column.key}_deviation"] = column.deviation(method)
                estimate = estimates.get((method.key, column.key))
                if estimate is not None:
                    row |= {f"{column.key}_{name}": getattr(estimate, name) for name in _ESTIMATED}
            rows.append(row)
    header = list(dict.fromkeys((*_HEADER, *(key for row in rows for key in row))))
    return [header, *([row.get(key) for key in header] for row in rows)]


def paper_columns(method: MethodResult, known: Columns) -> Columns:
    """The paper's supplement: true rotation (degrees) and translation (metres), n_k, and pose errors at n_k.

    Where the verification was repeated these are medians over the repeats.
    """
    k = main_k(method)
    names = {"name": "name", "dR": "dR", "dt": "dt", "nmin": f"n_{k}", "eR": f"eR_{k}", "et": f"et_{k}"}
    return {title: known[name] for title, name in names.items()}


def all_columns(method: MethodResult) -> Columns:
    """Everything that is known of each pair: both n_k and pose errors for every k, and the counts at every budget."""
    table = method.pairs
    named: Columns = {"name": table.name, "overlap": table.overlap, "gap": table.gap, "pixels": table.pixels}
    named |= {"dR": table.rotation, "dt": table.translation}
    named |= {"points0": method.points0, "points1": method.points1, "unknown": method.unknown}
    for index, k in enumerate(method.ks):
        named[f"n_{k}"] = median_needed(method, k)
        named[f"n_{k}_judged"] = median_needed(method, k, judged=True)
        named[f"eR_{k}"] = over_repeats(method.rotation_error[:, :, index])
        named[f"et_{k}"] = over_repeats(method.translation_error[:, :, index])
    for n, budget in sorted(method.budgets.items()):
        named[f"matches_at_{n}"] = budget.matches
        named[f"inliers_at_{n}"] = over_repeats(budget.inliers.astype(np.float64))
        named[f"eR_at_{n}"] = over_repeats(budget.rotation_error)
        named[f"et_at_{n}"] = over_repeats(budget.translation_error)
        named[f"repeatability_at_{n}"] = budget.repeatability
        named[f"matching_score_at_{n}"] = budget.matching_score
        named[f"spread_at_{n}"] = budget.spread
    return named


def _write(path: Path, rows: Iterable[Iterable[Any]]) -> Path:
    write_csv(path, (map(_without_decimals, row) for row in rows))  # inf and nan as such
    return path


def _without_decimals(cell: Any) -> Any:
    return int(cell) if isinstance(cell, float) and cell.is_integer() else cell

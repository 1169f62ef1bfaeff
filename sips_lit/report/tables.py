"""CSV files: a row per method, and a row per pair."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.evaluate.result import MethodResult, PairSetResult
from sips_lit.files import make_folder, safe_name, write_whole
from sips_lit.report.columns import columns_of
from sips_lit.report.summary import main_budget, main_k, median_needed, over_repeats

_HEADER: Final = ("pair_set", "detector", "name", "pairs", "k", "n_max", "n")


def write_tables(folder: Path, results: Sequence[PairSetResult]) -> list[Path]:
    """Writes ``summary.csv`` and, per pair set and method, ``<set>/<key>_pairs.csv`` and ``<set>/<key>_all.csv``.

    A failure is ``inf``, what is undefined ``nan``. Raises BadInputError when a file cannot be written.
    """
    written = [_write(folder / "summary.csv", summary_rows(results))]
    for result in results:
        subfolder = folder / safe_name(result.key)
        if result.detectors:
            make_folder(subfolder)
        for method in result.detectors:
            stem = safe_name(method.key)
            written.append(_write(subfolder / f"{stem}_pairs.csv", pair_rows(method)))
            written.append(_write(subfolder / f"{stem}_all.csv", wide_rows(method)))
    return written


def summary_rows(results: Sequence[PairSetResult]) -> list[list[str]]:
    """The header and a row for each method on each pair set, unrounded; a cell is empty where the set lacks a column."""
    rows: list[dict[str, str]] = []
    for result in results:
        columns = columns_of(result.detectors)
        for method in result.detectors:
            n = main_budget(method)
            row = {"pair_set": result.key, "detector": method.key, "name": method.name, "pairs": str(len(method.pairs))}
            row |= {"k": str(main_k(method)), "n_max": str(method.n_max), "n": "" if n is None else str(n)}
            for column in columns:
                row[column.key] = _text(column.value(method))
                if column.deviation is not None:
                    row[f"{column.key}_deviation"] = _text(column.deviation(method))
            rows.append(row)
    header = list(dict.fromkeys((*_HEADER, *(key for row in rows for key in row))))
    return [header, *([row.get(key, "") for key in header] for row in rows)]


def pair_rows(method: MethodResult) -> list[list[str]]:
    """The columns of the paper's supplement: true rotation (degrees) and translation (metres), n_k, and pose errors at n_k.

    Where the verification was repeated these are medians over the repeats.
    """
    k = main_k(method)
    at = method.ks.index(k)
    columns = [
        method.pairs.rotation,
        method.pairs.translation,
        median_needed(method, k),
        over_repeats(method.rotation_error[:, :, at]),
        over_repeats(method.translation_error[:, :, at]),
    ]
    return _rows(["name", "dR", "dt", "nmin", "eR", "et"], method.pairs.name, columns)


def wide_rows(method: MethodResult) -> list[list[str]]:
    """Everything that is known of each pair: n_k and pose errors for every k, and the counts at every budget."""
    table = method.pairs
    named: dict[str, NDArray[Any]] = {"overlap": table.overlap, "dR": table.rotation, "dt": table.translation}
    named |= {"points0": method.points0, "points1": method.points1}
    for index, k in enumerate(method.ks):
        named[f"n_{k}"] = median_needed(method, k)
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
    return _rows(["name", *named], table.name, list(named.values()))


def _rows(header: list[str], names: Sequence[str], columns: Sequence[Iterable[float]]) -> list[list[str]]:
    rows = zip(names, *columns, strict=True)
    return [header, *([name, *(_text(float(value)) for value in values)] for name, *values in rows)]


def _text(value: float) -> str:
    if math.isfinite(value) and value == int(value):
        return str(int(value))
    return repr(float(value))  # the shortest that reads back exactly; inf and nan as such


def _write(path: Path, rows: Sequence[Sequence[str]]) -> Path:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    write_whole(path, text.getvalue().encode())
    return path

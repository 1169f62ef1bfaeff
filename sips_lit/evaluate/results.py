"""Results on disk and on the screen: a table, JSON with the protocol, a CSV row a pair, curves and pictures."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate

from sips_lit.evaluate.evaluation import Evaluation
from sips_lit.render.curves import draw_succinctness
from sips_lit.render.reliability import draw_reliability


def table(evaluations: Sequence[Evaluation]) -> str:
    """The summary of several evaluations by the same protocol, best first, as Markdown."""
    first = evaluations[0].succinctness
    rows = [
        [
            e.name,
            "never" if e.succinctness.n_at_80 is None else e.succinctness.n_at_80,
            "never" if e.succinctness.median is None else e.succinctness.median,
            f"{e.succinctness.auc:.3f}",
            e.succinctness.failures,
            "" if e.calibration is None else f"{e.calibration.ece:.3f}",
        ]
        for e in sorted(evaluations, key=lambda e: -e.succinctness.auc)
    ]
    headers = ["detector", "n at 80 %", "median n", f"AUC-{first.n_max}", f"failures of {first.pairs}", "ECE"]
    alignment = ("left", *["right"] * (len(headers) - 1))
    # numbers are texts: tabulate would cut their trailing zeros
    return str(tabulate(rows, headers=headers, tablefmt="pipe", disable_numparse=True, colalign=alignment))


def protocol_line(evaluation: Evaluation) -> str:
    """One line that says how the numbers were obtained; details within details are in the JSON."""
    p = evaluation.protocol
    plain = (
        [(key, value) for key, value in check.items() if not isinstance(value, Mapping)] for check in p["verification"]
    )
    checks = "; ".join(", ".join(f"{key}={value}" for key, value in check) for check in plain)
    drawn = f"{p['pairs']} pairs of overlap >= {p['overlap']:g} (seed {p['seed']})"
    return f"k = {p['k']}, {drawn}, {p['search']} search, {checks}"


def write_results(folder: Path, evaluations: Mapping[str, Evaluation]) -> list[Path]:
    """Writes ``results.json``, ``curves.png``, and per evaluation ``<key>_pairs.csv`` and ``<key>_reliability.png``.

    Returns what was written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    summary = folder / "results.json"
    summary.write_text(json.dumps({key: as_plain(e) for key, e in evaluations.items()}, indent=2) + "\n")
    curves = folder / "curves.png"
    draw_succinctness({e.name: e.succinctness for e in evaluations.values()}).savefig(curves, dpi=120)
    written = [summary, curves]
    for key, evaluation in evaluations.items():
        rows = folder / f"{key}_pairs.csv"
        with rows.open("w", newline="") as handle:
            writer = csv.DictWriter(handle, fieldnames=["pair", "n_k", "points0", "points1", "matches", "inliers"])
            writer.writeheader()
            writer.writerows(asdict(row) for row in evaluation.rows)
        written.append(rows)
        if evaluation.calibration is not None:
            diagram = folder / f"{key}_reliability.png"
            draw_reliability(evaluation.calibration).savefig(diagram, dpi=120)
            written.append(diagram)
    return written


def as_plain(evaluation: Evaluation) -> dict[str, Any]:
    """An evaluation as JSON takes it."""
    plain: dict[str, Any] = {"name": evaluation.name, "protocol": evaluation.protocol}
    plain["succinctness"] = _plain(asdict(evaluation.succinctness))
    plain["calibration"] = None if evaluation.calibration is None else _plain(asdict(evaluation.calibration))
    return plain


def _plain(record: Mapping[str, Any]) -> dict[str, Any]:
    return {key: _defined(value.tolist() if isinstance(value, np.ndarray) else value) for key, value in record.items()}


def _defined(value: Any) -> Any:
    """JSON has no NaN: null instead."""
    if isinstance(value, list):
        return [_defined(v) for v in value]
    return None if isinstance(value, float) and math.isnan(value) else value

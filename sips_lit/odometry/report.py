"""Odometry's tables, figures and files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from matplotlib.figure import Figure
from tabulate import tabulate

from sips_lit.files import make_folder, safe_name, write_csv, write_whole
from sips_lit.odometry.files import write_kitti, write_tum
from sips_lit.odometry.odometer import State
from sips_lit.odometry.result import ERRORS, OdometryResult, SequenceResult
from sips_lit.render.figure import figure_to_array
from sips_lit.render.styles import detector_styles
from sips_lit.render.trajectories import draw_against_n, draw_trajectories
from sips_lit.report.files import describe_machine
from sips_lit.report.stored import plain

FORMAT: Final = "sips_lit odometry 1"
PANELS: Final = 3  # numbers of points whose trajectories are drawn


def matrix(result: SequenceResult) -> str:
    """What n points a frame come to, as Markdown: the drift (frames without a pose where true poses are not known)."""
    ns = sorted({one.n for one in result.results})
    rows = {one.name: [one.name] for one in result.results}
    for one in sorted(result.results, key=lambda one: one.n):
        mean, spread = one.error("drift") if result.judged else one.bridged
        lost = one.bridged[0]
        cell = f"{mean:.2f} ± {spread:.2f}" if result.judged else f"{mean:.1f}"
        rows[one.name].append(f"{cell} ({lost:.3g})" if result.judged and lost else cell)
    headers = ["drift, % (bridged)" if result.judged else "bridged frames", *(f"n = {n}" for n in ns)]
    return _table(list(rows.values()), headers)


def table(result: SequenceResult) -> str:
    """Everything of each method and number of points, as Markdown."""
    headers = ["method", "n"]
    headers += ["drift, %", "ATE, m", "RPE, m", "RPE, deg"] if result.judged else []
    headers += ["bridged", "keyframes", "inliers", "ms", "bytes"]
    rows = []
    for one in result.results:
        row = [one.name, str(one.n)]
        for name, digits in zip(ERRORS[:4] if result.judged else (), (2, 3, 4, 3), strict=False):
            mean, spread = one.error(name)
            row.append(f"{mean:.{digits}f} ± {spread:.{digits}f}")
        row += [f"{one.bridged[0]:.3g}", f"{one.keyframes:.3g}", f"{one.inliers:.3g}"]
        rows.append([*row, f"{sum(one.milliseconds.values()):.0f}", f"{one.bytes:.0f}"])
    return _table(rows, headers)


def protocol_line(result: SequenceResult) -> str:
    """How the numbers came about, in a line."""
    p = result.protocol
    parts = [f"{p['frames']} frames", f"depth from {p['depth']['source']}", f"{p['estimator']}, {p['threshold']:g} px"]
    parts += [f"{p['iterations']} iterations", f"at least {p['min_inliers']} inliers"]
    errors = [run.errors for one in result.results for run in one.runs if run.errors is not None]
    if errors:
        parts.append(f"drift over {errors[0].segments} segments of {errors[0].segment:.3g} m")
    return ", ".join([*parts, f"mean ± deviation of seeds {', '.join(map(str, p['seeds']))}"])


def write_results(folder: Path, results: Sequence[SequenceResult], date: str) -> list[Path]:
    """Writes ``results.json``, ``results.csv``, ``table.md``, and per sequence trajectories and figures; returns the files.

    Raises BadInputError when one cannot be written.
    """
    make_folder(folder)
    content = {
        "format": FORMAT,
        "date": date,
        "machine": describe_machine(),
        "sequences": [_record(r) for r in results],
    }
    written = [folder / name for name in ("results.json", "results.csv", "table.md")]
    write_whole(written[0], (json.dumps(plain(content), allow_nan=False) + "\n").encode())
    write_csv(written[1], rows(results))
    pages = (f"## {r.name}\n\n{matrix(r)}\n\n{table(r)}\n\n{protocol_line(r)}\n" for r in results)
    write_whole(written[2], "\n".join(pages).encode())
    for result in results:
        written += _write_trajectories(folder / "trajectories" / safe_name(result.name), result)
        for name, figure in figures(result).items():
            written.append(folder / f"{safe_name(result.name)}_{name}.png")
            picture = cv2.cvtColor(figure_to_array(figure), cv2.COLOR_RGB2BGR)
            write_whole(written[-1], cv2.imencode(".png", picture)[1].tobytes())
    return written


def rows(results: Sequence[SequenceResult]) -> list[list[Any]]:
    """The header and a row for each sequence, method and number of points, unrounded."""
    stages = list(dict.fromkeys(s for r in results for one in r.results for s in one.milliseconds))
    header = ["sequence", "method", "name", "n", *(f"{e}{part}" for e in ERRORS for part in ("", "_deviation"))]
    header += ["bridged", "keyframes", "inliers", "points", "bytes", *(f"{stage}_ms" for stage in stages)]
    table: list[list[Any]] = [header]
    for result in results:
        for one in result.results:
            errors = [value for name in ERRORS for value in one.error(name)]
            counts = [one.bridged[0], one.keyframes, one.inliers, one.points, one.bytes]
            times = [one.milliseconds.get(stage) for stage in stages]
            table.append([result.name, one.key, one.name, one.n, *errors, *counts, *times])
    return table


def figures(result: SequenceResult) -> dict[str, Figure]:
    """Trajectories of the first seed, and the drift against n where there are several."""
    if not result.results:
        return {}
    styles = detector_styles(one.name for one in result.results)
    ns = sorted({one.n for one in result.results})
    chosen = ns if len(ns) <= PANELS else [ns[0], ns[len(ns) // 2 - 1], ns[-1]]
    panels = {f"n = {n}": {o.name: o.runs[0].poses[:, :3, 3] for o in result.results if o.n == n} for n in chosen}
    drawn = {"trajectories": draw_trajectories(panels, result.truth[:, :3, 3] if result.judged else None, styles)}
    if len(ns) > 1 and result.judged:
        by_name: dict[str, list[OdometryResult]] = {name: [] for name in styles}
        for one in sorted(result.results, key=lambda one: one.n):
            by_name[one.name].append(one)
        values = {name: _columns([one.error("drift") for one in each]) for name, each in by_name.items()}
        drawn["drift"] = draw_against_n(values, ns, styles, "drift, % of the distance")
    return drawn


def _columns(pairs: Sequence[tuple[float, float]]) -> tuple[Any, Any]:
    means, deviations = np.array(pairs, np.float64).T
    return means, deviations


def _write_trajectories(folder: Path, result: SequenceResult) -> list[Path]:
    known = np.isfinite(result.truth).all((1, 2))
    listed = [(Path("truth"), result.times[known], result.truth[known])] if known.any() else []
    for one in result.results:
        for seed, run in zip(result.protocol["seeds"], one.runs, strict=True):
            listed.append((Path(safe_name(one.key)) / f"n{one.n}_seed{seed}", result.times, run.poses))
    written = []
    for stem, times, poses in listed:
        tum, kitti = (folder / stem.with_suffix(suffix) for suffix in (".tum", ".kitti"))
        write_tum(tum, times.tolist(), poses)
        write_kitti(kitti, poses)
        written += [tum, kitti]
    return written


def _record(result: SequenceResult) -> dict[str, Any]:
    """A sequence for JSON; the poses are in the files of the trajectories."""
    methods = []
    for one in result.results:
        runs = [
            {
                "errors": run.errors,
                "bridged": np.flatnonzero(run.state == State.BRIDGED),
                "keyframes": np.flatnonzero(run.keyframe),
            }
            | {"inliers": run.inliers}
            for run in one.runs
        ]
        about = {"key": one.key, "name": one.name, "n": one.n, "points": one.points, "bytes": one.bytes}
        methods.append(about | {"milliseconds": one.milliseconds, "runs": runs})
    return {"name": result.name, "protocol": result.protocol, "methods": methods, "skipped": result.skipped}


def _table(rows: Sequence[Sequence[str]], headers: Sequence[str]) -> str:
    alignment = ("left", *["right"] * (len(headers) - 1))
    return str(tabulate(rows, headers=headers, tablefmt="pipe", disable_numparse=True, colalign=alignment))

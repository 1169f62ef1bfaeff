"""Everything that an evaluation leaves behind, from its records."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import cv2
from torch.utils.tensorboard import SummaryWriter

from sips_lit.errors import BadInputError
from sips_lit.evaluate.result import PairSetResult
from sips_lit.files import make_folder, safe_name, write_whole
from sips_lit.progress import progress
from sips_lit.render.canvas import Picture
from sips_lit.render.figure import figure_to_array
from sips_lit.report.columns import columns_of
from sips_lit.report.embedding import svg_of
from sips_lit.report.figures import Styles, charts
from sips_lit.report.intervals import Intervals
from sips_lit.report.labels import styles_of, told_apart
from sips_lit.report.page import PairPictures, report_page
from sips_lit.report.pair_pictures import PairPicture
from sips_lit.report.stored import store_results
from sips_lit.report.tables import write_tables

_CPU_INFO: Final = Path("/proc/cpuinfo")


def write_report(
    folder: Path,
    results: Sequence[PairSetResult],
    pictures: PairPictures,
    date: str | None = None,
    machine: Mapping[str, str] | None = None,
    intervals: Mapping[str, Intervals] | None = None,
    notes: Sequence[str] = (),
) -> list[Path]:
    """Writes ``report.html``, ``results.json``, ``summary.csv``, CSV per pair set and method, figures and TensorBoard.

    ``date`` is shown as given; ``machine`` describes where the times were measured, this one if None; ``intervals`` by
    the keys of the pair sets; ``notes``: sentences at the head of the page. Returns the files.

    Raises BadInputError when one cannot be written, or a picture cannot be read.
    """
    make_folder(folder)
    results = [told_apart(result) for result in results]
    styles = styles_of(results)
    numbers, page = folder / "results.json", folder / "report.html"
    machine = describe_machine() if machine is None else machine
    drawn = _write_pictures(folder / "pictures", pictures)
    store_results(numbers, results, date, machine, drawn)
    written = [numbers, *write_tables(folder, results, intervals)]
    written += [one.image for of_method in drawn.values() for one in of_method if isinstance(one.image, Path)]
    with SummaryWriter(str(folder / "tensorboard")) as writer:
        log_numbers(writer, results)
        written += _write_figures(folder / "figures", results, styles, writer)
    html = report_page(results, pictures, styles, date, machine, intervals, notes)
    write_whole(page, html.encode())
    return [page, *written, folder / "tensorboard"]


def describe_machine() -> dict[str, str]:
    """Processor (the model where Linux tells it, else what Python knows), cores and system; not whose machine it is."""
    lines = _CPU_INFO.read_text().splitlines() if _CPU_INFO.is_file() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": models[0] if models else platform.processor() or platform.machine() or "unknown",
        "cores": str(os.cpu_count() or "unknown"),
        "system": f"{platform.system()} {platform.machine()}",
        "Python": platform.python_version(),
    }


def log_numbers(writer: SummaryWriter, results: Sequence[PairSetResult]) -> None:
    """Logs ``benchmark/<set>/<method>/<column>`` in TensorBoard for each finite number of the tables."""
    for result in results:
        columns = columns_of(result.detectors)
        for method in result.detectors:
            for column in columns:
                value = column.value(method)
                if math.isfinite(value):
                    writer.add_scalar(f"benchmark/{result.key}/{method.key}/{column.key}", value)


def _write_figures(folder: Path, results: Sequence[PairSetResult], styles: Styles, writer: SummaryWriter) -> list[Path]:
    """``<set>_<figure>.png`` and ``.svg``, and ``benchmark/<set>/<figure>`` in TensorBoard."""
    written = []
    for result in progress(results, desc="figures", unit="pair set"):
        for chart in charts(result, styles):
            make_folder(folder)
            stem = folder / f"{safe_name(result.key)}_{chart.key}"
            picture = figure_to_array(chart.figure)
            chart.figure.set_layout_engine("none")  # it is laid out now; doing it anew for the SVG would take as long
            written += [_write_png(stem.with_suffix(".png"), picture), stem.with_suffix(".svg")]
            write_whole(written[-1], svg_of(chart.figure).encode())
            writer.add_image(f"benchmark/{result.key}/{chart.key}", picture, dataformats="HWC")
    return written


def _write_pictures(folder: Path, pictures: PairPictures) -> dict[tuple[str, str], list[PairPicture]]:
    """The pictures as files of the folder, at full size; those of other folders are copied."""
    written = {}
    for (pair_set, method), drawn in pictures.items():
        files = []
        for picture in drawn:
            make_folder(folder / safe_name(pair_set))
            path = folder / safe_name(pair_set) / f"{safe_name(method)}_{safe_name(picture.label)}.png"
            if not isinstance(picture.image, Path):
                _write_png(path, picture.image)
            elif not path.exists() or not path.samefile(picture.image):
                write_whole(path, _content(picture.image))
            files.append(replace(picture, image=path))
        written[pair_set, method] = files
    return written


def _content(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise BadInputError(f"the picture {file} can't be read ({error.strerror}): leave it out") from error


def _write_png(path: Path, picture: Picture) -> Path:
    write_whole(path, cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))[1].tobytes())
    return path

"""A long training of a tiny model: memory, open files, threads and step time of its last quarter against its first.

python benchmarks/long_run.py [--steps 20000] [--minutes 600] [--figure long_run.png]
Runs sips-train with all its callbacks on small frames; a callback more notes what its processes use, every 50 steps. The
first 3000 steps do not count: workers start, the first validation opens what the others use again, and memory grows until it
settles. Other load makes steps longer, never shorter, so of times the fastest tenth counts, and what has a limit is the
time of processors.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import lightning as L
import numpy as np
import psutil
from numpy.typing import NDArray
from tabulate import tabulate

EVERY = 50  # steps between two samples
WARM_UP = 3000  # steps, but at most half of a run
COLUMNS = ("step", "MB", "open files", "threads", "processor ms a step", "ms a step")
SMALL = (
    "model=tiny",
    "data=folder",
    "module.points=50",
    "n_max=50",
    "datamodule.val_pairs=5",
    "datamodule.loading_workers=1",
    "trainer.val_check_interval=200",
    "trainer.accelerator=cpu",
)
LIMITS = {"MB": 1.05, "open files": 1.0, "threads": 1.0, "processor ms a step": 1.1}  # last quarter / first


class Recorder(L.Callback):
    """Writes a row of `COLUMNS` to ``path`` every `EVERY` steps; a stretch with a validation in it is left out."""

    def __init__(self, path: str) -> None:
        self.path, self.own = Path(path), psutil.Process()
        self._since: tuple[float, float] | None = None
        self._children: list[psutil.Process] = []

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._since = None

    def on_train_batch_end(self, trainer: L.Trainer, *_: Any) -> None:
        if trainer.global_step % EVERY:
            return
        now, before = (time.perf_counter(), self._processor_seconds()), self._children
        self._children = self.own.children(recursive=True)
        # at the end of a stretch workers are gone, and their times
        if self._since is not None and self._children == before:
            wall, used = (1000 * (a - b) / EVERY for a, b in zip(now, self._since, strict=True))
            processes = [self.own, *self._children]
            memory = sum(map(_own_bytes, processes)) / 1e6
            files, threads = (sum(values) for values in zip(*map(_handles, processes), strict=True))
            with self.path.open("a") as file:
                csv.writer(file).writerow([trainer.global_step, memory, files, threads, used, wall])
        self._since = time.perf_counter(), self._processor_seconds()

    def _processor_seconds(self) -> float:
        times = [process.cpu_times() for process in (self.own, *self.own.children(recursive=True))]
        return float(sum(t.user + t.system for t in times))


def _own_bytes(process: psutil.Process) -> int:
    """Memory that holds no file: pages of libraries would count less whenever another program loads the same ones.

    What processes share is divided among them, so that a sum counts it once (Linux; elsewhere what each has for itself).
    """
    told = Path(f"/proc/{process.pid}/smaps_rollup")
    if not told.exists():
        return int(process.memory_full_info().uss)
    lines = (line.split() for line in told.read_text().splitlines())
    return sum(1024 * int(line[1]) for line in lines if line[0] in ("Pss_Anon:", "Pss_Shmem:"))


def _handles(process: psutil.Process) -> tuple[int, int]:
    return process.num_fds(), process.num_threads()


def write_frames(folder: Path, count: int = 60) -> None:
    """A flight over noise, 128x96."""
    folder.mkdir()
    noise = np.random.default_rng(0).integers(0, 255, (60, 80), np.uint8)
    ground = cv2.resize(noise, (640, 480), interpolation=cv2.INTER_CUBIC)
    for index in range(count):
        cv2.imwrite(str(folder / f"{index:03d}.png"), ground[index : index + 96, 2 * index : 2 * index + 128])


def train(folder: Path, steps: int, minutes: float) -> NDArray[np.float64]:
    """The rows that `Recorder` wrote."""
    write_frames(folder / "frames")
    hours, rest = divmod(int(minutes), 60)
    seconds = round(60 * (minutes - int(minutes)))
    recorder = f"+callbacks.recorder={{_target_: long_run.Recorder, path: {folder / 'rows.csv'}}}"
    keys = [
        f"data.path={folder / 'frames'}",
        f"trainer.max_steps={steps}",
        f"trainer.max_time='00:{hours:02d}:{rest:02d}:{seconds:02d}'",
        f"paths.data={folder / 'data'}",
        f"hydra.run.dir={folder / 'run'}",
        recorder,
    ]
    here = str(Path(__file__).parent)
    code = f"import sys; sys.path.insert(0, {here!r}); from sips_lit.cli.train import main; main()"
    subprocess.run([sys.executable, "-c", code, *SMALL, *keys], check=True, stdout=subprocess.DEVNULL)
    return np.loadtxt(folder / "rows.csv", delimiter=",")


def quarters(rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Medians of the columns (of times tenth percentiles) in the first and last quarter of the rows after the warm-up."""
    counted = rows[rows[:, 0] > min(WARM_UP, rows[-1, 0] / 2)]
    length = max(1, len(counted) // 4)
    shares = [10 if name.endswith("ms a step") else 50 for name in COLUMNS]

    def of_each(part: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([np.percentile(column, share) for column, share in zip(part.T, shares, strict=True)])

    return of_each(counted[:length]), of_each(counted[-length:])


def draw(rows: NDArray[np.float64], path: Path) -> None:
    """A panel for each column against the step."""
    from sips_lit.render.figure import LINE_COLOURS, clean, new_figure

    figure = new_figure(8, 7)
    for axes, (at, name) in zip(figure.subplots(len(COLUMNS) - 1, sharex=True), enumerate(COLUMNS[1:], 1), strict=True):
        axes.plot(rows[:, 0], rows[:, at], color=LINE_COLOURS[0], linewidth=0.8)
        axes.set_ylim(0, 1.2 * np.percentile(rows[:, at], 99))
        axes.set_title(name, loc="left", fontsize=9)
        clean(axes)
    axes.set_xlabel("step")
    figure.savefig(path)


def report(rows: NDArray[np.float64]) -> list[str]:
    """Prints both quarters beside the limits; returns what is over its limit."""
    first, last = quarters(rows)
    table, over = [], []
    for name, a, b in list(zip(COLUMNS, first, last, strict=True))[1:]:
        table.append([name, a, b, b / a, LIMITS.get(name)])
        over += [name] if b / a > LIMITS.get(name, np.inf) else []
    print(f"{rows[-1, 0]:.0f} steps, {len(rows)} samples; the first and the last quarter after the warm-up")
    print(tabulate(table, ["", "first", "last", "last / first", "limit"], floatfmt=".2f"))
    return over


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--minutes", type=float, default=600, help="after which the run ends, with the steps it has")
    parser.add_argument("--figure", type=Path, default=Path("long_run.png"))
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = train(Path(folder), arguments.steps, arguments.minutes)
    draw(rows, arguments.figure)
    np.savetxt(arguments.figure.with_suffix(".csv"), rows, "%.1f", ",", header=",".join(COLUMNS), comments="")
    over = report(rows)
    print(f"figure: {arguments.figure}, and its numbers as .csv")
    if over:
        sys.exit(f"over the limit: {', '.join(over)}")


if __name__ == "__main__":
    main()

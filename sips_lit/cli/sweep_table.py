"""What a sweep ends with: a table of its jobs, and the command line of the best."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import yaml
from hydra.core.utils import JobReturn
from hydra.experimental.callback import Callback
from omegaconf import DictConfig
from tabulate import tabulate

from sips_lit.cli.next_steps import pasted
from sips_lit.cli.validation_record import FILE, digest_in
from sips_lit.files import write_whole

RESULT = "result.yaml"
"""File of a job's folder, beside its overrides: the score that it returned, or why it failed."""
LONGEST = 60  # characters of a reason in the table


@dataclass(frozen=True, slots=True)
class Job:
    """A job of a sweep: its folder, its overrides, its score (NaN without one), and why it has none.

    ``judged_on``: digest of what the score was measured on, None where that is not told.
    """

    folder: Path
    overrides: tuple[str, ...]
    score: float
    problem: str | None
    judged_on: str | None = None


class SweepTable(Callback):
    """Keeps what each job of a sweep returned in its folder, in whatever process the launcher runs it."""

    sweep: ClassVar[Path | None] = None
    """Folder of the sweep that this process has started."""

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Notes the folder: Hydra does not call ``on_multirun_end`` where a job has failed."""
        SweepTable.sweep = Path(config.hydra.sweep.dir)

    def on_job_start(self, config: DictConfig, **_: Any) -> None:
        """Forgets what a job of the same folder returned before."""
        _result(config).unlink(missing_ok=True)

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **_: Any) -> None:
        """Writes down the score, or why there is none."""
        if str(config.hydra.mode).rpartition(".")[2] != "MULTIRUN":
            return
        try:
            score = job_return.return_value
            kept: dict[str, float | str] = {"score": float(score)} if isinstance(score, int | float) else {}
        except Exception as error:  # whatever the job ended with, which Hydra tells at the end of the sweep
            kept = {"problem": str(error).removeprefix("a job failed: ")}
        write_whole(_result(config), yaml.safe_dump(kept).encode())


def _result(config: DictConfig) -> Path:
    return Path(config.hydra.runtime.output_dir) / str(config.hydra.output_subdir) / RESULT


@contextmanager
def table_at_end(command: str) -> Iterator[None]:
    """Prints the table of the sweep that runs within, if one does, whatever it ends with."""
    SweepTable.sweep = None
    try:
        yield
    finally:
        if SweepTable.sweep is not None and (jobs := read_jobs(SweepTable.sweep)):
            print(report(command, jobs), flush=True)


def read_jobs(sweep: Path) -> list[Job]:
    """The jobs whose folders are in that of a sweep, by their numbers."""
    files = [file for file in sweep.rglob("overrides.yaml") if file.parent.parent != sweep]
    return sorted(map(_job, files), key=lambda job: (len(job.folder.name), job.folder.name))


def _job(file: Path) -> Job:
    overrides = yaml.safe_load(file.read_text(encoding="utf-8")) or []
    result = file.with_name(RESULT)
    found = yaml.safe_load(result.read_text(encoding="utf-8")) if result.is_file() else {"problem": "did not end"}
    folder, score = file.parents[1], float(found.get("score", math.nan))
    return Job(folder, tuple(overrides), score, found.get("problem"), digest_in(folder))


def report(command: str, jobs: Sequence[Job]) -> str:
    """A row for each job, with what tells it from the others, and the command line of the one with the highest AUC.

    Where jobs were not all validated on the same, a column tells on what, and there is a best one of each.
    """
    common = set.intersection(*(set(job.overrides) for job in jobs)) if len(jobs) > 1 else set()
    scored = [job for job in jobs if math.isfinite(job.score)]
    validations = list(dict.fromkeys(job.judged_on for job in scored))
    rows = []
    for job in jobs:
        own = " ".join(pasted(override) for override in job.overrides if override not in common)
        told = f"{job.score:.3f}" if math.isfinite(job.score) else _short(job.problem or "none")
        rows.append([own, told, *([job.judged_on or ""] if len(validations) > 1 else []), str(job.folder)])
    head = ["overrides", "best AUC", *(["validated on"] if len(validations) > 1 else []), "folder"]
    lines = ["", tabulate(rows, head, tablefmt="pipe", disable_numparse=True), ""]
    if len(validations) > 1:
        lines.append(f"jobs were not validated on the same, see {FILE} in their folders: only AUCs of the same compare")
    for validation in validations:
        best = max((job for job in scored if job.judged_on == validation), key=lambda job: job.score)
        again = [pasted(override) for override in best.overrides if not override.startswith("ckpt_path=")]
        where = f" on {validation}" if len(validations) > 1 else ""
        lines += [f"best{where}: AUC {best.score:.3f} in {best.folder}", f"  {shlex.join([f'sips-{command}', *again])}"]
    return "\n".join(lines)


def _short(problem: str) -> str:
    first = " ".join(problem.split())
    return "failed: " + (first if len(first) <= LONGEST else f"{first[:LONGEST]}...")

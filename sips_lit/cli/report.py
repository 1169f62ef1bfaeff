"""sips-report: the report of stored results once more, or of several in one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from sips_lit.cli.app import run, typed
from sips_lit.cli.evaluation import labels_of, tell_written
from sips_lit.report.files import write_report
from sips_lit.report.intervals import intervals
from sips_lit.report.merging import merge
from sips_lit.report.restored import restore_results
from sips_lit.report.terminal import summary


@dataclass
class ReportOptions:
    """Types of the keys of ``conf/report.yaml``."""

    results: list[str]
    output: str
    resamples: int
    seed: int


def report(config: DictConfig) -> None:
    """Prints a table per pair set, and writes the report to ``output``."""
    plain = OmegaConf.create({key: config[key] for key in ReportOptions.__annotations__})
    if isinstance(plain.results, str):
        plain.results = [plain.results]
    options, folder = typed(plain, ReportOptions), Path(config.output)
    merged = merge([restore_results(Path(file)) for file in options.results], labels_of(config))
    for note in merged.notes:
        print(f"note: {note}")
    estimates = {result.key: intervals(result, options.resamples, options.seed) for result in merged.results}
    for result in merged.results:
        print(f"\n{summary(result, estimates[result.key], folder / 'summary.md')}")
    written = write_report(
        folder, merged.results, merged.pictures, merged.date, merged.machine, estimates, merged.notes
    )
    tell_written(folder, written)


main = partial(run, "report", report)

if __name__ == "__main__":
    main()

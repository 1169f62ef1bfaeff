"""sips-benchmark: many detectors on the same pairs, on one pair set or several."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import cv2
from omegaconf import DictConfig, OmegaConf

from sips_lit.cli.app import build, run
from sips_lit.cli.contenders import make_contenders, parse_entries
from sips_lit.errors import BadInputError
from sips_lit.evaluate.benchmark import BenchmarkPairs, run_contenders
from sips_lit.evaluate.benchmark_pictures import draw_benchmark_pictures
from sips_lit.evaluate.benchmark_result import PairSetResult
from sips_lit.evaluate.benchmark_table import protocol_line, table
from sips_lit.evaluate.measure import Measures
from sips_lit.evaluate.pair_choice import choose_pairs
from sips_lit.evaluate.pair_file import write_pair_file
from sips_lit.evaluate.report.files import write_report
from sips_lit.evaluate.report.pair_pictures import PairPicture
from sips_lit.evaluate.report.summary import summary
from sips_lit.frames.folder import safe_name
from sips_lit.frames.source import as_sources

OWN_KEYS = ("kind", "pairs", "overlap", "pairs_file", "seed")
"""What a pair set may set for itself."""


@dataclass(frozen=True, slots=True)
class PairSet:
    """A pair set, ready to be measured; ``drawn`` says how its pairs were chosen."""

    key: str
    title: str
    pairs: BenchmarkPairs
    drawn: Mapping[str, Any]


def benchmark(config: DictConfig) -> float | None:
    """Measures, prints a table a pair set, writes the report. Returns the best AUC on the first pair set."""
    cv2.setNumThreads(-1)
    entries, measures = parse_entries(config.detectors), read_measures(config)
    folder, cache = Path(config.paths.run), Path(config.features)
    skipped: dict[str, str] = {}
    contenders = make_contenders(config, entries, _told(skipped))
    results: list[PairSetResult] = []
    pictures: dict[tuple[str, str], Sequence[PairPicture]] = {}
    for pair_set in make_pair_sets(config, folder):
        left_out = dict(skipped)
        measured = run_contenders(
            contenders, pair_set.pairs, measures, cache, config.workers, pair_set.title, _told(left_out)
        )
        protocol = {**pair_set.pairs.protocol, **pair_set.drawn}
        results.append(PairSetResult(pair_set.key, pair_set.title, protocol, tuple(measured), left_out))
        print(f"\n{pair_set.title}\n\n{table(results[-1])}\n\n{protocol_line(results[-1], measures)}")
        if config.pictures:
            drawn = draw_benchmark_pictures(measured, contenders, pair_set.pairs, measures, cache)
            pictures |= {(pair_set.key, key): of_detector for key, of_detector in drawn.items()}
    written = write_report(folder, results, pictures)
    print("\nwrote:\n" + "\n".join(f"  {path}" for path in written))
    return best_auc(results)


def _told(skipped: dict[str, str]) -> Callable[[str, str], None]:
    """Writes down what is left out and why, and says so at once."""

    def skip(key: str, reason: str) -> None:
        skipped[key] = reason
        print(f"skipped {key}: {reason}")

    return skip


def best_auc(results: list[PairSetResult]) -> float | None:
    """The best succinctness AUC on the first pair set; None if no detector could be measured."""
    return max((summary(detector).auc for detector in results[0].detectors), default=None)


def make_pair_sets(config: DictConfig, folder: Path) -> list[PairSet]:
    """The pair sets of the configuration, or else that of its data; each one's pairs are written to a file.

    Raises BadInputError for keys that a pair set does not have.
    """
    entries: dict[str, Any] = {str(key): entry for key, entry in config.pair_sets.items() if entry is not None}
    if not entries:
        entries = {"data": OmegaConf.create({})}
    return [_pair_set(config, key, entry, folder) for key, entry in entries.items()]


def _pair_set(config: DictConfig, key: str, entry: DictConfig, folder: Path) -> PairSet:
    allowed = ("title", "data", "inliers", *OWN_KEYS)
    unknown = next((str(name) for name in entry if name not in allowed), None)
    if unknown is not None:
        raise BadInputError(f"pair_sets.{key} sets {unknown}, which no pair set has: it can set {', '.join(allowed)}")
    drawn = {name: entry[name] if name in entry else config[name] for name in OWN_KEYS}
    data, inliers = (build(entry[name] if name in entry else config[name]) for name in ("data", "inliers"))
    sources = as_sources(data)
    listed = choose_pairs(sources, config.paths.indexes, **drawn, workers=config.workers)
    pairs = BenchmarkPairs(sources, listed, inliers)
    write_pair_file(folder / safe_name(key) / "pairs.csv", pairs.sequences, listed)
    if drawn["pairs_file"] is not None:
        drawn = {"pairs_file": Path(drawn["pairs_file"]).name}
    elif drawn["kind"] != "random":
        drawn = {"kind": drawn["kind"]}
    else:
        drawn = {name: drawn[name] for name in ("kind", "overlap", "seed")}
    return PairSet(key, str(entry.get("title", key)), pairs, drawn)


def read_measures(config: DictConfig) -> Measures:
    """What is measured, from the keys of the same names."""
    values = {field.name: config[field.name] for field in fields(Measures)}
    plain: Any = OmegaConf.to_container(OmegaConf.create(values), resolve=True)
    read: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in plain.items()}
    return Measures(**read)


def main() -> None:
    """Entry point."""
    run("benchmark", benchmark)


if __name__ == "__main__":
    main()

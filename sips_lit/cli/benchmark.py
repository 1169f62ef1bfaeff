"""sips-benchmark: many detectors on the same pairs, on one pair set or several."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import date
from pathlib import Path
from typing import Any

import cv2
from omegaconf import DictConfig, ListConfig, OmegaConf

from sips_lit.cli.app import build, run
from sips_lit.cli.methods import make_methods, parse_entries
from sips_lit.errors import BadInputError
from sips_lit.evaluate.measure import Measures
from sips_lit.evaluate.method import Method
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.evaluate.result import PairSetResult
from sips_lit.evaluate.runner import has_probabilities, run_methods
from sips_lit.files import safe_name
from sips_lit.frames.frame_cache import FrameCache
from sips_lit.frames.source import as_sources
from sips_lit.inference.score_video import write_score_video
from sips_lit.pairs.choice import choose_pairs
from sips_lit.pairs.pair_file import write_pair_file
from sips_lit.report.files import write_report
from sips_lit.report.method_pictures import draw_benchmark_pictures
from sips_lit.report.pair_pictures import PairPicture
from sips_lit.report.summary import summary
from sips_lit.report.terminal import protocol_line, table

CHOICE = ("kind", "pairs", "overlap", "pairs_file", "seed")
"""Keys that say how pairs are chosen."""
MEASURED = tuple(field.name for field in fields(Measures))
"""Keys that say what is measured."""


@dataclass(frozen=True, slots=True)
class MeasuredPairSet:
    """A pair set, ready to be measured by ``measures``; ``chosen`` says how its pairs were."""

    key: str
    title: str
    pairs: PairSet
    measures: Measures
    chosen: Mapping[str, Any]


def benchmark(config: DictConfig) -> float | None:
    """Measures, prints a table a pair set, writes the report. Returns the best AUC on the first pair set."""
    cv2.setNumThreads(-1)
    entries = parse_entries(config.detectors)
    folder, cache = Path(config.paths.run), Path(config.features)
    skipped: dict[str, str] = {}
    methods = make_methods(config, entries, _told(skipped))
    results: list[PairSetResult] = []
    videos: list[Path] = []
    pictures: dict[tuple[str, str], Sequence[PairPicture]] = {}
    for pair_set in make_pair_sets(config, folder):
        pairs, measures, left_out = pair_set.pairs, pair_set.measures, dict(skipped)
        measured = run_methods(methods, pairs, measures, cache, config.workers, pair_set.title, _told(left_out))
        protocol = {**pairs.protocol, **pair_set.chosen}
        videos += write_videos(folder / safe_name(pair_set.key), methods, pairs, measures, config.video_frames)
        results.append(PairSetResult(pair_set.key, pair_set.title, protocol, tuple(measured), left_out))
        print(f"\n{pair_set.title}\n\n{table(results[-1])}\n\n{protocol_line(results[-1], measures)}")
        if config.pictures:
            drawn = draw_benchmark_pictures(measured, methods, pairs, measures, cache)
            pictures |= {(pair_set.key, key): of_detector for key, of_detector in drawn.items()}
    written = write_report(folder, results, pictures, date.today().isoformat()) + videos
    print("\nwrote:\n" + "\n".join(f"  {path}" for path in written))
    return best_auc(results)


def write_videos(
    folder: Path, methods: Sequence[Method], pairs: PairSet, measures: Measures, frames: int
) -> list[Path]:
    """A video of the first sequence by each different SIPs detector: score map and best points of every frame on its own."""
    written: dict[int, Path] = {}
    n = measures.budgets[0] if measures.budgets else measures.n_max
    for method in methods if frames > 0 else ():
        if has_probabilities(method) and id(method.detector) not in written:
            path = folder / f"{method.key}_scores.mp4"
            write_score_video(path, pairs.sequences[0], method.detector, n, frames)
            written[id(method.detector)] = path
    return list(written.values())


def _told(skipped: dict[str, str]) -> Callable[[str, str], None]:
    """Writes down what is left out and why, and says so at once."""

    def skip(key: str, reason: str) -> None:
        skipped[key] = reason
        print(f"skipped {key}: {reason}")

    return skip


def best_auc(results: list[PairSetResult]) -> float | None:
    """The best succinctness AUC on the first pair set; None if no detector could be measured."""
    return max((summary(detector).auc for detector in results[0].detectors), default=None)


def make_pair_sets(config: DictConfig, folder: Path) -> list[MeasuredPairSet]:
    """The pair sets of the configuration, or else that of its data; each one's pairs are written to a file.

    Raises BadInputError for keys that a pair set does not have.
    """
    entries: dict[str, Any] = {str(key): entry for key, entry in config.pair_sets.items() if entry is not None}
    if not entries:
        entries = {"data": OmegaConf.create({})}
    memory = FrameCache()
    return [_pair_set(config, key, entry, folder, memory) for key, entry in entries.items()]


def _pair_set(config: DictConfig, key: str, entry: DictConfig, folder: Path, memory: FrameCache) -> MeasuredPairSet:
    allowed = tuple(dict.fromkeys(("title", "data", "inliers", *CHOICE, *MEASURED)))
    unknown = next((str(name) for name in entry if name not in allowed), None)
    if unknown is not None:
        raise BadInputError(f"pair_sets.{key} sets {unknown}, which no pair set has: it can set {', '.join(allowed)}")

    def value(name: str) -> Any:
        found = entry[name] if name in entry else config[name]
        return tuple(found) if isinstance(found, ListConfig) else found

    measures = Measures(**{name: value(name) for name in MEASURED})
    choice: dict[str, Any] = {name: value(name) for name in CHOICE}
    data, inliers = build(value("data")), build(value("inliers"))
    sources = as_sources(data)
    listed = choose_pairs(sources, config.paths.indexes, **choice, workers=config.workers)
    pairs = PairSet(sources, listed, inliers, memory).judgeable()
    write_pair_file(folder / safe_name(key) / "pairs.csv", pairs.sequences, listed)
    if pairs.left_out:
        print(
            f"{key}: left out {len(pairs.left_out)} pairs whose depth or pose is not known: {', '.join(pairs.left_out)}"
        )
    return MeasuredPairSet(key, str(entry.get("title", key)), pairs, measures, _in_words(choice))


def _in_words(choice: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a choice of pairs that mattered."""
    if choice["pairs_file"] is not None:
        return {"pairs_file": Path(choice["pairs_file"]).name}
    if choice["kind"] != "random":
        return {"kind": choice["kind"]}
    return {name: choice[name] for name in ("kind", "overlap", "seed")}


def main() -> None:
    """Entry point."""
    run("benchmark", benchmark)


if __name__ == "__main__":
    main()

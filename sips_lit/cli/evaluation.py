"""Methods on pair sets, from the configuration to the report: what sips-evaluate and sips-benchmark run.

The keys of ``conf/evaluation`` say what is measured on which pairs. They hold for every pair set; an entry of ``pair_sets``
overrides them for its own. Without entries there is one pair set, of the keys themselves.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from datetime import date
from pathlib import Path
from typing import Any

import cv2
from hydra.errors import InstantiationException
from omegaconf import DictConfig, ListConfig, OmegaConf

from sips_lit.cli.app import build, typed
from sips_lit.cli.data_names import name_of_data
from sips_lit.detect.sanitise import Defects
from sips_lit.errors import BadInputError, LeftOutWarning
from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.method import Method
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.evaluate.result import PairSetResult
from sips_lit.evaluate.runner import evaluate_pair_set
from sips_lit.files import safe_name
from sips_lit.frames.frame_cache import FrameCache
from sips_lit.frames.source import Source, as_sources
from sips_lit.inference.score_video import write_score_video
from sips_lit.pairs.choice import choose_pairs, write_pair_file
from sips_lit.report.columns import auc_of
from sips_lit.report.files import describe_machine, write_report
from sips_lit.report.intervals import Intervals, intervals
from sips_lit.report.labels import labelled, refuse_unknown_labels, told_apart
from sips_lit.report.pair_pictures import PairPicture, draw_method_pictures
from sips_lit.report.stored import store_results
from sips_lit.report.terminal import summary


@dataclass
class Keys:
    """The keys of an evaluation beside what is measured, with their types."""

    kind: str
    pairs: int
    overlap: float
    overlap_below: float | None
    pairs_file: str | None
    seed: int
    refine_poses: bool
    features: str
    pictures: bool
    video_frames: int
    workers: int
    resamples: int


CHOICE = ("kind", "pairs", "overlap", "overlap_below", "pairs_file", "seed")
"""Keys that say how pairs are chosen."""
MEASURED = tuple(field.name for field in fields(Measures))
"""Keys that say what is measured."""
PAIR_SET = tuple(dict.fromkeys(("title", "data", "inliers", "refine_poses", *CHOICE, *MEASURED)))
"""Keys that an entry of ``pair_sets`` may have."""


def run_evaluation(
    config: DictConfig, methods: Sequence[Method], skipped: Mapping[str, str], folder: Path
) -> list[PairSetResult]:
    """Measures, prints a table per pair set, writes the report to ``folder``. ``skipped``: methods that could not be made.

    Raises BadInputError when no method at all could be measured.
    """
    cv2.setNumThreads(-1)
    labels = labels_of(config)
    refuse_unknown_labels(labels, [(m.key, m.descriptor_name) for m in methods], skipped)
    results: list[PairSetResult] = []
    estimates: dict[str, Intervals] = {}
    videos: list[Path] = []
    pictures: dict[tuple[str, str], Sequence[PairPicture]] = {}
    pair_sets = make_pair_sets(config, folder)
    cache = Path(config.features)
    for pairs, measures in pair_sets:
        measured = evaluate_pair_set(methods, pairs, measures, cache, config.workers, told({}))
        result = labelled(replace(measured, skipped={**skipped, **measured.skipped}), labels)
        results.append(result)
        estimates[result.key] = intervals(result, config.resamples, measures.seed)
        print(f"\n{summary(result, estimates[result.key], folder / 'summary.md')}")
        for method in result.detectors:
            mended = str(Defects(**method.defects))
            if mended:
                print(f"sanitised: {method.name}: {mended}")
        videos += write_videos(folder / safe_name(pairs.key), methods, pairs, measures.n, config.video_frames)
        if config.pictures:
            drawn = draw_method_pictures(result.detectors, methods, pairs, measures, cache)
            pictures |= {(pairs.key, key): of_method for key, of_method in drawn.items()}
        if len(results) < len(pair_sets):  # hours may be to come: sips-report makes a report of these
            store_results(folder / "results.json", list(map(told_apart, results)), machine=describe_machine())
    if not any(result.detectors for result in results):
        reasons = "; ".join(sorted({reason for result in results for reason in result.skipped.values()}))
        raise BadInputError(f"no method could be measured: {reasons}")
    today = date.today().isoformat()
    written = write_report(folder, results, pictures, today, intervals=estimates) + videos
    tell_written(folder, written)
    return results


def labels_of(config: DictConfig) -> dict[str, str]:
    """The key ``labels``. Raises BadInputError for anything but names of methods with labels."""
    given: Any = {} if config.labels is None else config.labels
    if not isinstance(given, Mapping) or not all(isinstance(label, str | int | float) for label in given.values()):
        raise BadInputError(
            f"labels is {given}: give names of methods with their labels, those with more than letters in double quotes, "
            "and all of it in single ones: 'labels={sips: ours, sift: \"SIFT (OpenCV)\"}'"
        )
    return {str(key): str(label) for key, label in given.items()}


def tell_written(folder: Path, files: Sequence[Path]) -> None:
    """Prints the files in a folder by name, those in its subfolders by their number."""
    inside = Counter(file.relative_to(folder).parts[0] for file in files if file.parent != folder)
    own = [str(file) for file in files if file.parent == folder and file.name not in inside]
    own += [f"{folder / name}/ ({count} {'file' if count == 1 else 'files'})" for name, count in inside.items()]
    print("\nwrote:\n" + "\n".join(f"  {line}" for line in own))


def told(skipped: dict[str, str]) -> Callable[[str, str], None]:
    """Writes down what is left out and why, and says so at once."""

    def skip(key: str, reason: str) -> None:
        skipped[key] = reason
        print(f"skipped {key}: {reason}")

    return skip


def best_auc(results: Sequence[PairSetResult]) -> float:
    """The best succinctness AUC on the first pair set: what a sweep maximises. NaN where no method was measured."""
    return max((auc_of(method) for method in results[0].detectors), default=float("nan"))


def make_pair_sets(config: DictConfig, folder: Path) -> list[tuple[PairSet, Measures]]:
    """The pair sets of the configuration with what is measured on them; each one's pairs are written to a file.

    Raises BadInputError for keys that a pair set does not have, and for values that none can have.
    """
    given: Any = {} if config.pair_sets is None else config.pair_sets
    if not isinstance(given, Mapping) or not all(isinstance(entry, DictConfig | None) for entry in given.values()):
        raise BadInputError(
            f"pair_sets is {given}: give each pair set by its name, with its keys: {{city: {{pairs: 40}}}}"
        )
    entries: dict[str, Any] = {str(key): entry for key, entry in given.items() if entry is not None}
    if not entries:
        entries = {"": OmegaConf.create({})}
    cache = FrameCache()
    return [_pair_set(config, key, entry, folder, cache) for key, entry in entries.items()]


def _pair_set(
    config: DictConfig, key: str, entry: DictConfig, folder: Path, cache: FrameCache
) -> tuple[PairSet, Measures]:
    unknown = next((str(name) for name in entry if name not in PAIR_SET), None)
    if unknown is not None:
        raise BadInputError(f"pair_sets.{key} sets {unknown}, which no pair set has: it can set {', '.join(PAIR_SET)}")

    def value(name: str) -> Any:
        found = entry[name] if name in entry else config.get(name)
        return tuple(found) if isinstance(found, ListConfig) else found

    measures, keys = _checked(value, key if config.pair_sets else None)
    choice: dict[str, Any] = {name: getattr(keys, name) for name in CHOICE}
    sources, inliers = _all_of(value("data")), build(value("inliers"))
    key, title = (key, str(entry.get("title", key))) if key else name_of_data(value("data"), sources)
    listed = choose_pairs(sources, config.paths.indexes, **choice, workers=keys.workers)
    whole = PairSet(sources, listed, inliers, cache, key, title, _in_words(choice), keys.refine_poses)
    pairs = whole.verifiable()
    write_pair_file(folder / safe_name(key) / "pairs.csv", pairs.sequences, listed)
    if pairs.left_out:
        print(
            f"{key}: left out {len(pairs.left_out)} pairs whose depth or pose is not known: {', '.join(pairs.left_out)}"
        )
    return pairs, measures


def _checked(value: Callable[[str], Any], pair_set: str | None) -> tuple[Measures, Keys]:
    """What a pair set measures, and its other keys. Raises BadInputError for a value that can't be used."""
    try:
        missing = next((name for name in ("data", "inliers") if value(name) is None), None)
        if missing is not None:
            raise BadInputError(f"{missing} is not set")
        plain = OmegaConf.create({field.name: value(field.name) for field in fields(Keys)})
        return Measures(**{name: value(name) for name in MEASURED}), typed(plain, Keys)
    except BadInputError as error:
        raise BadInputError(f"pair_sets.{pair_set}: {error}") if pair_set else error from None


def _all_of(data: DictConfig) -> list[Source]:
    """The sources of a data set of which nothing may be missing. Raises BadInputError where a recording can't be read."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", LeftOutWarning)
        try:
            return as_sources(build(data))
        except InstantiationException as error:
            if isinstance(error.__cause__, LeftOutWarning):
                raise BadInputError(f"an evaluation needs every recording: {error.__cause__}") from error
            raise


def _in_words(choice: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a choice of pairs that mattered."""
    if choice["pairs_file"] is not None:
        return {"pairs_file": Path(choice["pairs_file"]).name}
    if choice["kind"] != "random":
        return {"kind": choice["kind"]}
    return {name: choice[name] for name in ("kind", "overlap", "overlap_below", "seed") if choice[name] is not None}


def write_videos(folder: Path, methods: Sequence[Method], pairs: PairSet, n: int, frames: int) -> list[Path]:
    """A video of the first sequence by each different detector with probabilities: score map and ``n`` points per frame."""
    written: dict[int, Path] = {}
    for method in methods if frames > 0 else ():
        if method.detector.scores == "probability" and id(method.detector) not in written:
            path = folder / f"{method.key}_scores.mp4"
            write_score_video(path, pairs.sequences[0], method.detector, n, frames)
            written[id(method.detector)] = path
    return list(written.values())

"""sips-speed: where the milliseconds of an image go, of any detectors on the same images in turn."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import torch
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from tabulate import tabulate

from sips_lit.cli.app import build, run, typed
from sips_lit.cli.explain import explain
from sips_lit.cli.methods import Entry, parse_entries, with_detector
from sips_lit.cli.next_steps import after_speed, told
from sips_lit.cli.peak_memory import peak_memory
from sips_lit.datasets.demo import demo_photograph
from sips_lit.errors import BadInputError
from sips_lit.evaluate.method import Method
from sips_lit.evaluate.speed import STEPS, Speed, measure_speed, synthetic_image
from sips_lit.files import make_folder, write_csv, write_whole
from sips_lit.inference.streams import open_stream
from sips_lit.progress import progress
from sips_lit.report.files import describe_machine
from sips_lit.types import Detector, GreyImage


@dataclass
class SpeedOptions:
    """The types of ``conf/speed.yaml``, which documents the keys."""

    input: str | None
    size: Any
    images: int
    n: int
    rounds: int
    threads: int | None
    runtime: str
    precision: Any
    memory: bool
    checkpoint: str
    detectors: Any
    descriptor: Any
    output: str


@dataclass(frozen=True, slots=True)
class Candidate:
    """A method, and the plain configuration that its detector is made of."""

    method: Method
    config: dict[str, Any]


def speed(config: DictConfig) -> None:
    """Measures, prints the table, and writes ``speed.json`` and ``speed.csv``."""
    options = typed(config, SpeedOptions)
    for key in ("images", "n", "rounds", "threads"):
        value = getattr(options, key)
        if value is not None and value < 1:
            raise BadInputError(f"{key} is {value}: give a number from 1")
    set_threads(options.threads)
    images, path, source, decode = read_images(options)
    candidates = make_candidates(config)
    speeds = measure_speed([each.method for each in candidates], images, options.n, options.rounds)
    peaks = peaks_of(candidates, images[0], options.n) if options.memory else [None] * len(candidates)
    threads, version = torch.get_num_threads(), torch.__version__
    print(f"\n{table(speeds, peaks)}\n")
    shape, cores = f"{images[0].shape[1]}x{images[0].shape[0]}", "thread" if threads == 1 else "threads"
    print(
        f"milliseconds per image, medians of {options.rounds} rounds in turn (least: of the points); {source}, {shape}, "
        f"at most {options.n} points, {threads} {cores}, PyTorch {version}"
    )
    if decode is not None:
        print(f"decoding: {decode:.1f} ms per image")
    protocol = {"source": source, "size": shape, "images": len(images), "n": options.n, "rounds": options.rounds}
    protocol |= {"threads": threads, "torch": version, "opencv": cv2.__version__, **describe_machine()}
    write(Path(options.output), speeds, peaks, {**protocol, "decode_ms": decode})
    following = after_speed(path, fastest_of_ours(candidates, speeds))
    if following and HydraConfig.get().mode == RunMode.RUN:
        print(told(following))


def fastest_of_ours(candidates: Sequence[Candidate], speeds: Sequence[Speed]) -> dict[str, Any] | None:
    """The configuration of the fastest detector that sips-detect runs; None where none was measured."""
    ours = [(speed.median("points") or 0.0, at) for at, speed in enumerate(speeds) if "path" in candidates[at].config]
    return candidates[min(ours)[1]].config if ours else None


def set_threads(threads: int | None) -> None:
    """Of PyTorch and OpenCV; None: as many as PyTorch takes."""
    if threads is not None:
        torch.set_num_threads(threads)
    cv2.setNumThreads(torch.get_num_threads())


def read_images(options: SpeedOptions) -> tuple[list[GreyImage], Path | None, str, float | None]:
    """The images, where they are, what they are in words, and the milliseconds of decoding one; None for one made up."""
    size = size_of(options.size)
    if options.input is None:
        try:
            path, source = demo_photograph(), "a photograph of scikit-image (motorcycle)"
        except BadInputError:
            return [synthetic_image(size or (640, 480))], None, "an image that is made up (no scikit-image here)", None
    else:
        path, source = Path(options.input), Path(options.input).name
    images: list[GreyImage] = []
    taken = []
    for _ in range(5):
        start = time.perf_counter()
        images = [frame.grey for frame in islice(open_stream(path, colour=False), options.images)]
        taken.append(1e3 * (time.perf_counter() - start) / len(images))
    if size is not None:
        images = [np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8) for image in images]
    return images, path, source, float(np.median(taken))


def size_of(given: Any) -> tuple[int, int] | None:
    """Width and height. Raises BadInputError for anything but two numbers above 0, and null."""
    if given is None:
        return None
    if not isinstance(given, list) or len(given) != 2 or not all(type(side) is int and side > 0 for side in given):
        raise BadInputError(f"size is {given}: give width and height, like size=[640,480], or null")
    return given[0], given[1]


def make_candidates(config: DictConfig) -> list[Candidate]:
    """The detectors that can be made, with the common descriptor or their own; says which are left out and why.

    Raises BadInputError where none is left.
    """
    descriptor, candidates = build(config.descriptor), []
    for entry in parse_entries(config.detectors):
        shared = {"runtime": config.runtime, "precision": config.precision} if entry.detector == "sips" else {}
        whole = with_detector(config, Entry(entry.detector, {**shared, **entry.overrides}))
        try:
            detector: Detector = build(whole.detector)
            if descriptor is None and not detector.describes:
                raise BadInputError(
                    f"{detector.name} does not describe its points: give a common descriptor, as rootsift"
                )
        except Exception as error:  # whatever a package does that is missing or broken: if it can be told, others go on
            reason = explain(error, whole)
            if reason is None:
                raise
            print(f"skipped {entry.key}: {reason}")
            continue
        method = Method(entry.key, detector.name + entry.note, detector, descriptor, {})
        candidates.append(Candidate(method, cast(dict[str, Any], OmegaConf.to_container(whole.detector, resolve=True))))
    if not candidates:
        raise BadInputError("none of the detectors can be made: the reasons stand above")
    return candidates


def peaks_of(candidates: Sequence[Candidate], image: GreyImage, n: int) -> list[float | None]:
    """Megabytes that each detector needs above the interpreter."""
    listed = progress(candidates, desc="memory", unit="detector")
    return [peak_memory(each.config, image, n, torch.get_num_threads()) for each in listed]


def table(speeds: Sequence[Speed], peaks: Sequence[float | None]) -> str:
    """Markdown."""
    headers = ["detector", "points", "least", *STEPS[1:], "peak MB"]
    rows = [
        [each.name, each.median("points"), each.least("points"), *(each.median(step) for step in STEPS[1:]), peak]
        for each, peak in zip(speeds, peaks, strict=True)
    ]
    texts = [
        [row[0], *(_number(cell) for cell in row[1:-1]), "" if row[-1] is None else f"{row[-1]:.0f}"] for row in rows
    ]
    alignment = ("left", *["right"] * (len(headers) - 1))
    return str(tabulate(texts, headers, tablefmt="pipe", disable_numparse=True, colalign=alignment))


def _number(value: Any) -> str:
    return "" if value is None else f"{value:.1f}"


def write(folder: Path, speeds: Sequence[Speed], peaks: Sequence[float | None], protocol: dict[str, Any]) -> None:
    """Writes all numbers, and says where."""
    make_folder(folder)
    listed = [{**asdict(each), "peak_mb": peak} for each, peak in zip(speeds, peaks, strict=True)]
    write_whole(
        folder / "speed.json", (json.dumps({"protocol": protocol, "detectors": listed}, indent=1) + "\n").encode()
    )
    header = ["detector", "name", "points", "round", *(f"{step}_ms" for step in STEPS)]
    rows = [
        [
            each.key,
            each.name,
            each.found,
            turn,
            *(each.milliseconds.get(step, [None] * (turn + 1))[turn] for step in STEPS),
        ]
        for each in speeds
        for turn in range(len(each.milliseconds["points"]))
    ]
    write_csv(folder / "speed.csv", [header, *rows])
    print(f"wrote to {folder}: speed.json, speed.csv")


main = partial(run, "speed", speed)

if __name__ == "__main__":
    main()

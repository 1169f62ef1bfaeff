"""sips-detect: the points of an image, a folder of images, or a video."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, get_args

import torch
from omegaconf import DictConfig

from sips_lit.cli.app import build, run, typed
from sips_lit.detect.budget import Budget
from sips_lit.detect.detector import SipsDetector
from sips_lit.errors import BadInputError
from sips_lit.inference.batch import DetectionSummary, detect_stream
from sips_lit.inference.streams import FrameStream, open_stream
from sips_lit.inference.writers import Format, PointWriter, open_writer


@dataclass
class DetectOptions:
    """The types of ``conf/detect.yaml``, which documents the keys."""

    checkpoint: str
    input: str
    names: str | None
    output: str
    format: Any
    descriptor: Any
    n: int
    threshold: float | None
    k: int | None
    confidence: float
    n_max: int
    nms_radius: int | None
    border: int | None
    octaves: int | None
    first_octave: float | None
    octave_step: float | None
    corners: float | None
    fine_corners: float | None
    whole_below: int | None
    scales: int | None
    subpixel: bool
    device: str
    runtime: str
    precision: Any


def detect(config: DictConfig) -> None:
    """Detects in every frame; prints what was written and where, also when a frame cannot be read."""
    options = typed(config, DetectOptions)
    kinds = formats(options.format)
    budget = Budget(options.n, options.threshold, options.k, options.confidence, options.n_max)
    detector = SipsDetector.from_checkpoint(
        options.checkpoint,
        choose_device(options.device),
        subpixel=options.subpixel,
        nms_radius=options.nms_radius,
        border=options.border,
        octaves=options.octaves,
        first_octave=options.first_octave,
        octave_step=options.octave_step,
        corners=options.corners,
        fine_corners=options.fine_corners,
        whole_below=options.whole_below,
        scales=options.scales,
        runtime=options.runtime,
        precision=options.precision,
    )
    stream = open_stream(Path(options.input), "overlay" in kinds, options.names)
    folder, summary = Path(options.output), DetectionSummary()
    descriptor = build(config.descriptor)
    writers = [open_writer(kind, folder, stream.fps, descriptor) for kind in kinds]
    try:
        detect_stream(detector, stream, budget, writers, summary, detector.recalibration)
    finally:
        if summary.frames:
            print(report(folder, summary, stream, budget, writers))


def choose_device(name: str) -> torch.device:
    """``auto`` is the GPU where there is one. Raises BadInputError for a device that is not there."""
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    if name not in ("cpu", "cuda"):
        raise BadInputError(f"device is {name}: give auto, cpu or cuda")
    if name == "cuda" and not torch.cuda.is_available():
        raise BadInputError("device is cuda, but PyTorch finds no GPU: use device=cpu, or device=auto")
    return torch.device(name)


def formats(given: Any) -> list[Format]:
    """The output formats, of one name or a list of names. Raises BadInputError for unknown ones."""
    names = [given] if isinstance(given, str) else given
    known: tuple[Format, ...] = get_args(Format)
    if not isinstance(names, list) or not names or any(name not in known for name in names):
        raise BadInputError(f"format is {given}: give one or several of {', '.join(known)}, like format=[npz,csv]")
    return [kind for kind in known if kind in names]


def report(
    folder: Path, summary: DetectionSummary, stream: FrameStream, budget: Budget, writers: Sequence[PointWriter]
) -> str:
    """What was done, in a few lines."""
    count = "1 frame" if summary.frames == 1 else f"{summary.frames} frames"
    if stream.total is not None and stream.total != summary.frames:
        count += f" (of {stream.total} announced)"
    mean = summary.points / max(1, summary.frames)
    lines = [f"{count}, {mean:.1f} points per frame on average ({budget})"]
    if summary.short:
        lines.append(
            f"{summary.short} of them have too few good points for {budget.k} inliers with probability "
            f"{budget.confidence:g}: all their points, at most {budget.n_max}, were kept"
        )
    return "\n".join([*lines, f"wrote to {folder}: {', '.join(writer.written for writer in writers)}"])


main = partial(run, "detect", detect)

if __name__ == "__main__":
    main()

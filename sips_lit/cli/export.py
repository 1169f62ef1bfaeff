"""sips-export: a trained network for other programs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from omegaconf import DictConfig

from sips_lit.cli.app import run, typed
from sips_lit.detect.budget import Budget
from sips_lit.detect.checkpoint import export_safetensors, load_checkpoint, require_finite
from sips_lit.detect.detector import SipsDetector
from sips_lit.errors import BadInputError
from sips_lit.export.dense_map import DenseMap
from sips_lit.export.program import IMAGE_TYPES, Exportable, Size
from sips_lit.export.top_k import TopPoints
from sips_lit.export.usage import usage
from sips_lit.export.write import NEEDS, SUFFIXES, require_packages, write_model
from sips_lit.files import make_folder

FORMATS: Final = ("safetensors", *SUFFIXES)
OF_POINTS: Final = ("n", "threshold", "k", "nms_radius", "border", "scales")


@dataclass
class ExportOptions:
    """The types of ``conf/export.yaml``, which documents the keys."""

    checkpoint: str
    format: str
    output: str | None
    points: bool
    image_type: str
    size: list[int] | None
    n: int | None
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


def export(config: DictConfig) -> None:
    """Exports, checks, and prints what was written and how it is used."""
    options = typed(config, ExportOptions)
    refuse_contradictions(options)
    budget = budget_of(options)
    network, selector = load_checkpoint(options.checkpoint)
    path = output_path(options)
    outputs: tuple[str, ...] = ()
    require_finite(network, options.checkpoint)
    if options.format == "safetensors":
        make_folder(path.parent)
        written = export_safetensors(asked_detector(options).network, selector, path)
    else:
        require_packages(options.format)
        model = model_of(options, budget)
        whole = network.detection.whole_below if options.whole_below is None else 0
        if options.size is None and whole and model.network.detection.first_octave:
            print(
                f"images of fewer than {whole:,} pixels are scored whole by the detector, and as large ones by a model for "
                "any size: if yours are so small, give their size, such as size=[320,240]"
            )
        outputs = model.outputs
        make_folder(path.parent)
        written, difference = write_model(model, options.format, path, options.image_type, size_of(options))
        print(f"{NEEDS[options.format].runtime} against the detector: {difference}")
        if isinstance(model, DenseMap) and network.scales > 1:
            print(
                f"the network detects on {network.scales} scales, a factor {network.scale_factor:.3f} apart: "
                "the model is for one of them, run it on each level of an image pyramid"
            )
    print("wrote:\n" + "\n".join(f"  {file} ({file.stat().st_size / 1000:,.1f} kB)" for file in written))
    print(f"\n{usage(options.format, path, outputs, options.image_type)}")


def refuse_contradictions(options: ExportOptions) -> None:
    """Raises BadInputError for unknown values, and for keys that another one makes meaningless."""
    if options.format not in FORMATS:
        raise BadInputError(f"format is {options.format}: give {', '.join(FORMATS[:-1])} or {FORMATS[-1]}")
    if options.image_type not in IMAGE_TYPES:
        raise BadInputError(f"image_type is {options.image_type}: give {' or '.join(IMAGE_TYPES)}")
    if options.points and options.format == "safetensors":
        raise BadInputError(f"points=true needs a program, not weights alone: give format={' or '.join(SUFFIXES)}")
    if options.size is not None and (len(options.size) != 2 or min(options.size) < 1):
        raise BadInputError(
            f"size is {list(options.size)}: give width and height of the images, such as size=[640,480]"
        )
    if options.size is not None and options.format == "safetensors":
        raise BadInputError(f"size={list(options.size)} needs a program, not weights alone: give format=onnx, say")
    given = [name for name in OF_POINTS if getattr(options, name) is not None]
    if not options.subpixel:
        given.append("subpixel")
    if given and not options.points:
        raise BadInputError(f"{', '.join(given)}: how points are chosen is a part of the model with points=true only")
    if options.size is None and options.whole_below and options.format != "safetensors":
        raise BadInputError(
            f"whole_below is {options.whole_below}: a model for any size scores all images alike; give the size of yours, "
            "such as size=[320,240]"
        )
    if options.n is not None and options.k is not None:
        raise BadInputError(
            f"n is {options.n} and k is {options.k}: give n for a fixed number of points, or k for enough"
        )


def size_of(options: ExportOptions) -> Size | None:
    """The only (H, W) that the model takes; None: any."""
    return None if options.size is None else (options.size[1], options.size[0])


def budget_of(options: ExportOptions) -> Budget:
    """How many points the model keeps. Raises BadInputError for values out of range."""
    n = 50 if options.n is None else options.n
    return Budget(n, options.threshold, options.k, options.confidence, options.n_max)


def asked_detector(options: ExportOptions) -> SipsDetector:
    """The detector that is exported. Raises BadInputError as `SipsDetector.from_checkpoint`."""
    any_size = options.format != "safetensors" and options.size is None
    return SipsDetector.from_checkpoint(
        options.checkpoint,
        subpixel=options.subpixel,
        nms_radius=options.nms_radius,
        scales=options.scales,
        border=options.border,
        octaves=options.octaves,
        first_octave=options.first_octave,
        octave_step=options.octave_step,
        corners=options.corners,
        fine_corners=options.fine_corners,
        whole_below=0 if any_size else options.whole_below,  # a program's operations do not depend on a free size
    )


def model_of(options: ExportOptions, budget: Budget) -> Exportable:
    """The module that becomes a file. Raises BadInputError as `asked_detector` and `TopPoints`."""
    detector = asked_detector(options)
    if options.points:
        return TopPoints(detector.network, detector.selector, budget)
    return DenseMap(detector.network, detector.selector)


def output_path(options: ExportOptions) -> Path:
    """Where the export goes: beside the checkpoint unless ``output`` says otherwise, points as ``<name>-points``.

    Raises BadInputError for an ``output`` that is not named like its format.
    """
    suffix = SUFFIXES.get(options.format, ".safetensors")
    path = Path(options.checkpoint)
    path = path.with_name(f"{path.stem if path.suffix else path.name}{'-points' if options.points else ''}{suffix}")
    if options.output is not None:
        path = Path(options.output)
    if path.suffix != suffix:
        raise BadInputError(f"output is {path}: name a file that ends in {suffix}")
    return path


main = partial(run, "export", export)

if __name__ == "__main__":
    main()

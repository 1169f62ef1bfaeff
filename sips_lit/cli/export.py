"""sips-export: a trained network for other programs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from sips_lit.cli.app import run, typed
from sips_lit.detect.checkpoint import export_safetensors, load_checkpoint, require_finite
from sips_lit.errors import BadInputError
from sips_lit.export.onnx import SHAPES, export_onnx
from sips_lit.files import make_folder

FORMATS = ("safetensors", "onnx")

SAFETENSORS_USAGE = """\
from sips_lit import SipsDetector
detector = SipsDetector.from_checkpoint({path!r})
keypoints = detector("image.png", n=50)"""

ONNX_USAGE = """\
import cv2, numpy, onnxruntime
session = onnxruntime.InferenceSession({path!r})
probability = session.run(None, {{"image": numpy.float32(cv2.imread("image.png", 0))[None, None]}})[0][0, 0]"""


@dataclass
class ExportOptions:
    """The types of ``conf/export.yaml``, which documents the keys."""

    checkpoint: str
    format: str
    output: str | None


def export(config: DictConfig) -> None:
    """Exports, checks, and prints what was written and how it is used.

    ONNX holds the network for one image; of a multi-scale checkpoint the caller builds the pyramid (the text says so).
    """
    options = typed(config, ExportOptions)
    network, selector = load_checkpoint(options.checkpoint)
    path = output_path(options)
    require_finite(network, options.checkpoint)
    make_folder(path.parent)
    if options.format == "safetensors":
        written = export_safetensors(network, selector, path)
        usage = SAFETENSORS_USAGE
    else:
        difference = export_onnx(network, selector, path)
        print(f"ONNX Runtime and PyTorch differ by at most {difference:.1e} (probabilities, {len(SHAPES)} image sizes)")
        written, usage = [path], ONNX_USAGE
        if network.scales > 1:
            print(
                f"the network detects on {network.scales} scales, a factor {network.scale_factor:.3f} apart: "
                "the model is for one of them, run it on each level of an image pyramid"
            )
    print("wrote:\n" + "\n".join(f"  {file} ({file.stat().st_size / 1000:,.1f} kB)" for file in written))
    print(f"\n{usage.format(path=str(path))}")


def output_path(options: ExportOptions) -> Path:
    """Where the export goes: beside the checkpoint unless ``output`` says otherwise.

    Raises BadInputError for an unknown format or an ``output`` that is not named like one.
    """
    if options.format not in FORMATS:
        raise BadInputError(f"format is {options.format}: give {' or '.join(FORMATS)}")
    suffix = f".{options.format}"
    path = Path(options.output) if options.output is not None else Path(options.checkpoint).with_suffix(suffix)
    if path.suffix != suffix:
        raise BadInputError(f"output is {path}: name a file that ends in {suffix}")
    return path


main = partial(run, "export", export)

if __name__ == "__main__":
    main()

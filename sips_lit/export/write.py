"""A model as a file of some format: made, compared with the detector, and only then written."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from sips_lit.errors import BadInputError
from sips_lit.export.onnx import onnx_bytes
from sips_lit.export.openvino import openvino_bytes
from sips_lit.export.parity import Difference, Run, difference_of, run_onnx, run_openvino, run_program
from sips_lit.export.program import Exportable, Size, program_bytes, program_of
from sips_lit.files import write_together


@dataclass(frozen=True, slots=True)
class Needs:
    """What runs a format, and the packages that writing and comparing it needs."""

    runtime: str
    packages: tuple[str, ...]


SUFFIXES: Final = {"onnx": ".onnx", "openvino": ".xml", "torch_export": ".pt2"}
NEEDS: Final = {
    "onnx": Needs("ONNX Runtime", ("onnx", "onnxscript", "onnxruntime")),
    "openvino": Needs("OpenVINO", ("onnx", "onnxscript", "openvino")),
    "torch_export": Needs("torch.export", ()),
}


def require_packages(kind: str) -> None:
    """Raises BadInputError when a package that a format needs is missing."""
    missing = [name for name in NEEDS[kind].packages if importlib.util.find_spec(name) is None]
    if missing:
        raise BadInputError(
            f"format={kind} needs {', '.join(missing)}: install them with pip install 'sips_lit[export]'"
        )


def write_model(
    model: Exportable, kind: str, path: Path, image_type: str = "float32", size: Size | None = None
) -> tuple[list[Path], Difference]:
    """Writes a model, and returns its files and how far its runtime is from the detector.

    ``kind``: one of `SUFFIXES`; of openvino ``path`` names the .xml, beside which goes the .bin; ``image_type`` and
    ``size``: see `program_of`.

    Raises BadInputError when a package is missing or a file can't be written, RuntimeError, with nothing written, when the
    model gives something else than the detector.
    """
    require_packages(kind)
    files, run = built(model, kind, image_type, size)
    difference = difference_of(model, run, image_type, size)
    if not difference.is_small:
        raise RuntimeError(
            f"{NEEDS[kind].runtime} gives something else than the detector ({difference}); nothing was written"
        )
    paths = {path.with_suffix(suffix): content for suffix, content in files.items()}
    write_together(paths)
    return list(paths), difference


def built(
    model: Exportable, kind: str, image_type: str = "float32", size: Size | None = None
) -> tuple[dict[str, bytes], Run]:
    """The contents of a model's files by suffix, and what runs them."""
    program = program_of(model, image_type, size)
    if kind == "torch_export":
        content = program_bytes(program, model)
        return {".pt2": content}, run_program(content)
    onnx = onnx_bytes(program, model)
    if kind == "onnx":
        return {".onnx": onnx}, run_onnx(onnx)
    xml, weights = openvino_bytes(onnx)
    return {".xml": xml, ".bin": weights}, run_openvino(xml, weights)

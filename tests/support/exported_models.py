"""Exported models of a tiny network, made once for all tests of a run: torch.export and the translation are slow."""

from __future__ import annotations

import functools
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from once_a_run import once_a_run
from tiny_network import tiny_network
from torch.export import ExportedProgram

from sips_lit.detect.budget import Budget
from sips_lit.detect.recalibration import Recalibration
from sips_lit.detect.selection import PointSelector
from sips_lit.export.dense_map import DenseMap
from sips_lit.export.onnx import onnx_bytes
from sips_lit.export.openvino import openvino_bytes
from sips_lit.export.parity import Run, run_onnx, run_openvino, run_program
from sips_lit.export.program import program_bytes, program_of
from sips_lit.export.top_k import TopPoints
from sips_lit.export.write import NEEDS, built

RECALIBRATED = PointSelector(4, border=3, recalibration=Recalibration(3.0, 4.6, 0.3, 1.1))
BUDGETS = {
    "best": Budget(60),
    "enough": Budget(k=4, threshold=0.35, confidence=0.7, n_max=15),
}
SIZES = [(120, 160), (97, 131), (1, 40), (5, 3), (2, 2), (1, 1)]
"""Usual, odd, a line, smaller than the receptive field, and a single pixel."""


def model_of(name: str) -> DenseMap | TopPoints:
    octaves = {
        "map": {"octaves": 2, "first_octave": 0.5, "octave_step": 0.5},
        "best": {"first_octave": 1, "fine_corners": 0.25},
        "enough": {"octaves": 2},
    }
    network = tiny_network(derivatives=True, corners=0.5, covariance=name == "enough", **octaves[name])
    if network.covariance_head is not None:
        torch.nn.init.normal_(network.covariance_head.weight, std=0.05, generator=torch.Generator().manual_seed(0))
    return DenseMap(network, RECALIBRATED) if name == "map" else TopPoints(network, RECALIBRATED, BUDGETS[name])


@functools.cache
def program(name: str, image_type: str) -> ExportedProgram:
    return program_of(model_of(name), image_type)


@functools.cache
def onnx_of(name: str, image_type: str) -> bytes:
    return once_a_run(f"{name}_{image_type}.onnx", lambda: onnx_bytes(program(name, image_type), model_of(name)))


@functools.cache
def exported(name: str, kind: str, image_type: str = "float32") -> tuple[dict[str, bytes], Run]:
    """Contents of the files of `model_of` by suffix, and what runs them; skips where a package is missing."""
    for package in NEEDS[kind].packages:
        pytest.importorskip(package, reason=f"{package} is missing: pip install 'sips_lit[export]'")
    if kind == "torch_export":
        content = once_a_run(
            f"{name}_{image_type}.pt2", lambda: program_bytes(program(name, image_type), model_of(name))
        )
        return {".pt2": content}, run_program(content)
    if kind == "onnx":
        return {".onnx": onnx_of(name, image_type)}, run_onnx(onnx_of(name, image_type))
    xml, weights = openvino_bytes(onnx_of(name, image_type))
    return {".xml": xml, ".bin": weights}, run_openvino(xml, weights)


@functools.cache
def of_one_size(name: str, size: tuple[int, int]) -> tuple[dict[str, bytes], Run]:
    """The same as ONNX for images of one size."""
    pytest.importorskip("onnxscript", reason="needs the extra export")
    return built(model_of(name), "onnx", size=size)


def textured(size: tuple[int, int], seed: int = 3) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """A grey image with structures of several sizes, even where it is tiny."""
    generator = np.random.default_rng(seed)
    coarse = cv2.resize(
        generator.uniform(0, 215, (40, 50)).astype(np.float32), (320, 240), interpolation=cv2.INTER_CUBIC
    )
    image = np.clip(coarse + generator.uniform(0, 40, coarse.shape), 0, 255).astype(np.uint8)
    return np.ascontiguousarray(image[: size[0], : size[1]])

"""Size and time of each format of sips-export, as a Markdown table: a thread, 640x480, the formats in turns.

python benchmarks/export_time.py [CHECKPOINT]
"""

from __future__ import annotations

import io
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from tabulate import tabulate

from sips_lit.detect.budget import Budget
from sips_lit.detect.checkpoint import export_safetensors
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.openvino_package import openvino_core
from sips_lit.export.dense_map import DenseMap
from sips_lit.export.onnx import onnx_bytes
from sips_lit.export.openvino import openvino_bytes
from sips_lit.export.program import Exportable, program_bytes, program_of
from sips_lit.export.top_k import TopPoints

ROUNDS = 15


def textured() -> NDArray[np.uint8]:
    generator = np.random.default_rng(0)
    coarse = generator.uniform(0, 200, (96, 128)).astype(np.float32)
    smooth = cv2.resize(coarse, (640, 480), interpolation=cv2.INTER_CUBIC)
    return np.clip(smooth + generator.uniform(0, 40, smooth.shape), 0, 255).astype(np.uint8)


def runner(kind: str, files: dict[str, bytes]) -> Callable[[NDArray[Any]], object]:
    """One thread; OpenVINO in float32."""
    if kind == "onnx":
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        session = onnxruntime.InferenceSession(files[".onnx"], options, providers=["CPUExecutionProvider"])
        return lambda image: session.run(None, {"image": image})
    if kind == "openvino":
        options = {"INFERENCE_PRECISION_HINT": "f32", "INFERENCE_NUM_THREADS": 1}
        core = openvino_core("export_time")
        return core.compile_model(core.read_model(files[".xml"], files[".bin"]), "CPU", options)
    module = torch.export.load(io.BytesIO(files[".pt2"])).module()
    return torch.no_grad()(lambda image: module(torch.from_numpy(image)))


def contents(model: Exportable) -> dict[str, dict[str, bytes]]:
    """The files of each format by suffix."""
    program = program_of(model)
    onnx = onnx_bytes(program, model)
    xml, weights = openvino_bytes(onnx)
    program_file = {".pt2": program_bytes(program, model)}
    return {"onnx": {".onnx": onnx}, "openvino": {".xml": xml, ".bin": weights}, "torch_export": program_file}


def main() -> None:
    warnings.filterwarnings("ignore", module="torch")
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    detector = SipsDetector.from_checkpoint(sys.argv[1] if len(sys.argv) > 1 else "sips-tiny", whole_below=0)
    grey = textured()
    image = grey[None, None].astype(np.float32)
    budgets = {"50 points": Budget(), "k=10, confidence 0.9, n_max 200": Budget(k=10, confidence=0.9, n_max=200)}
    models: dict[str, Exportable] = {"map": DenseMap(detector.network, detector.selector)}
    models |= {name: TopPoints(detector.network, detector.selector, budget) for name, budget in budgets.items()}
    runs: dict[tuple[str, str], Callable[[], object]] = {("safetensors", "map"): lambda: detector.score_map(grey)}
    runs |= {("safetensors", name): lambda b=budget: detector.within(grey, b) for name, budget in budgets.items()}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "weights.safetensors"
        export_safetensors(detector.network, detector.selector, path)
        sizes = {key: path.stat().st_size for key in runs}
    for name, model in models.items():
        for kind, files in contents(model).items():
            sizes[kind, name] = sum(map(len, files.values()))
            runs[kind, name] = partial(runner(kind, files), image)
    times: dict[tuple[str, str], list[float]] = {key: [] for key in runs}
    for _ in range(ROUNDS):
        for key, run in runs.items():
            start = time.process_time()
            run()
            times[key].append(1e3 * (time.process_time() - start))
    rows = [[*key, sizes[key] / 1e3, min(times[key])] for key in runs]
    print(tabulate(rows, ["format", "gives", "kB", "ms"], "github", floatfmt=(None, None, ".0f", ".1f")))


if __name__ == "__main__":
    main()

"""Exported models as ONNX, for images of any size, without PyTorch."""

from __future__ import annotations

import logging
import warnings
from importlib.metadata import version
from typing import Any

import torch
from torch.export import ExportedProgram

from sips_lit.export.program import Exportable, metadata_of


def onnx_bytes(program: ExportedProgram, model: Exportable) -> bytes:
    """The serialised ONNX model of a program, checked by ONNX itself.

    The metadata has what a reader may want to know. Needs the packages ``onnx`` and ``onnxscript``.
    """
    import onnx

    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it warns that torchvision is not installed
    with torch.no_grad(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        translated = torch.onnx.export(
            program,
            dynamo=True,
            input_names=["image"],
            output_names=list(model.outputs),
            custom_translation_table={torch.ops.aten.sort.stable: _stable_sort},
            verbose=False,
        )
    if translated is None:
        raise RuntimeError("the exporter gave no model")
    written: Any = translated.model_proto
    graph = written.graph
    for item in [*graph.node, *graph.input, *graph.output, *graph.initializer, graph]:
        del item.metadata_props[:]  # stack traces with the paths of this machine, several times the size of the rest
    del graph.value_info[:]  # shapes between the operations, which a reader infers
    written.doc_string = model.description
    written.producer_name, written.producer_version = "sips_lit", version("sips_lit")
    onnx.helper.set_model_props(written, metadata_of(model))
    onnx.checker.check_model(written, full_check=True)
    return bytes(written.SerializeToString())


def _stable_sort(values: Any, stable: bool | None = None, dim: int = -1, descending: bool = False) -> Any:
    """torch.sort(stable=True), which PyTorch does not translate: of equal values TopK takes the first one first."""
    from onnxscript import opset18 as op

    return op.TopK(values, op.Shape(values, start=dim, end=dim + 1), axis=dim, largest=int(descending), sorted=1)

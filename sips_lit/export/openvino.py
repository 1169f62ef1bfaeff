"""Exported models as OpenVINO's pair of files: the graph (.xml) and its numbers (.bin)."""

from __future__ import annotations

import io
import tempfile
from pathlib import Path

from sips_lit.detect.openvino_package import import_openvino


def openvino_bytes(onnx: bytes) -> tuple[bytes, bytes]:
    """The contents of ``.xml`` and ``.bin``, with float32 weights, of a serialised ONNX model. Needs ``openvino``."""
    openvino = import_openvino("format=openvino")
    model = openvino.convert_model(io.BytesIO(onnx))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.xml"
        openvino.save_model(model, path, compress_to_fp16=False)  # half precision moves points
        return path.read_bytes(), path.with_suffix(".bin").read_bytes()

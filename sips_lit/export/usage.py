"""The lines of Python that run an exported file, which the command prints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

SAFETENSORS = """\
from sips_lit import SipsDetector
detector = SipsDetector.from_checkpoint({path!r})
keypoints = detector("image.png", n=50)"""

IMAGE = """\
import cv2, numpy
image = cv2.imread("image.png", cv2.IMREAD_GRAYSCALE)[None, None].astype(numpy.{image_type})"""

RUNS = {
    "onnx": """\
import onnxruntime
session = onnxruntime.InferenceSession({path!r})
outputs = session.run(None, {{"image": image}})""",
    "openvino": """\
import openvino
model = openvino.compile_model({path!r}, "CPU", {{"INFERENCE_PRECISION_HINT": "f32"}})
outputs = list(model(image).values())""",
    "torch_export": """\
import torch
model = torch.export.load({path!r}).module()
outputs = [output.numpy() for output in model(torch.from_numpy(image))]""",
}

MAP = "probability = outputs[0][0, 0]"
POINTS = """\
count = int(outputs[2][0])
xy, probability = outputs[0][0, :count], outputs[1][0, :count]"""
COVARIANCE = "covariance = outputs[{at}][0, :count]"


def usage(kind: str, path: Path, outputs: Sequence[str], image_type: str) -> str:
    """Lines that read ``image.png`` and give its points or its map: what a model with these ``outputs`` gives."""
    if kind == "safetensors":
        return SAFETENSORS.format(path=str(path))
    lines = [IMAGE.format(image_type=image_type), RUNS[kind].format(path=str(path))]
    lines.append(POINTS if "count" in outputs else MAP)
    if "covariance" in outputs:
        lines.append(COVARIANCE.format(at=outputs.index("covariance")))
    return "\n".join(lines)

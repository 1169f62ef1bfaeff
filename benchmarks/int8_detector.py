"""A trained network in 8-bit integers by OpenVINO, for `sips-benchmark` and `sips-speed`: what they would gain and cost.

    pip install nncf
    export PYTHONPATH=benchmarks
    sips-speed 'detectors=[sips,{int8: {_target_: int8_detector.Int8Detector, path: sips-tiny, images: FOLDER}}]'

It is no part of the package: see docs/explanation/results.md, size against points.
"""

from __future__ import annotations

from typing import Any

import torch

from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.folding import whole_blocks
from sips_lit.detect.runtime import OpenVino
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import image_tensor
from sips_lit.frames.images import read_grey
from sips_lit.frames.listing import list_images

MOST_IMAGES = 50


class Int8(OpenVino):
    """Weights and activations of all convolutions in 8 bits, with the ranges that they have in a folder of images."""

    name = "openvino int8"

    def __init__(self, network: ScoreNetwork, images: str) -> None:
        import nncf

        super().__init__(network)
        files = list_images(images)
        tensors = (image_tensor(read_grey(file)) for file in files[:: -(-len(files) // MOST_IMAGES)])
        inputs = [{"image": whole_blocks(tensor, self.side).contiguous().numpy()} for tensor in tensors]
        self._whole = nncf.quantize(
            self.core.read_model(self.model), nncf.Dataset(inputs), preset=nncf.QuantizationPreset.MIXED
        )

    def _compile(self, shape: tuple[int, ...]) -> Any:
        model = self._whole.clone()
        model.reshape({"image": list(shape)})
        return self.core.compile_model(model, "CPU", self.options).create_infer_request()


class Int8Detector(SipsDetector):
    """The detector of a checkpoint or released weights, executed by `Int8`; ``images``: a folder that gives the ranges."""

    name = "SIPs int8"

    def __init__(self, path: str, images: str) -> None:
        plain = SipsDetector.from_checkpoint(path)
        super().__init__(plain.network, plain.selector)
        with torch.no_grad():
            self.runtime = Int8(plain.network, images)

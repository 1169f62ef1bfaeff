"""The score network as ONNX: a dense probability map of images of any size, without PyTorch."""

from __future__ import annotations

import importlib.util
import logging
import warnings
from collections import OrderedDict
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor, nn

from sips_lit.detect.checkpoint import METADATA_KEY, config_json
from sips_lit.detect.recalibration import AS_TRAINED, Recalibration
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.files import write_whole

TOLERANCE: Final = 1e-4
"""Greatest difference of probabilities between PyTorch and ONNX Runtime that is let through."""
SHAPES: Final = ((1, 1, 240, 320), (2, 1, 97, 131), (1, 1, 5, 3), (1, 1, 1, 1))
"""(B, 1, H, W) that both are compared on: usual, odd in a batch, and smaller than the receptive field."""
DESCRIPTION: Final = (
    "Succinct interest points: input `image` (B, 1, H, W) float32, grey, 0 to 255; output `probability` (B, 1, H, W) "
    "float32, of each pixel being an inlier if it is chosen as one of 50 interest points. Points are the local maxima "
    "within nms_radius (metadata `sips_lit`, selector), best first. With n points kept, add log_n * log(n / 50) to the "
    "logit (metadata `sips_lit`, recalibration; without one, nothing)."
)


def export_onnx(network: ScoreNetwork, selector: PointSelector, path: Path) -> float:
    """Writes the network as an ONNX model with dynamic B, H and W, once ONNX Runtime agrees with PyTorch about it.

    Only the network: a multi-scale detector's pyramid stays outside, so that the model gives the map of one level, and the
    caller runs it on each level. The metadata entry ``sips_lit`` holds the configuration as JSON, ``sips_lit_version``
    the version that wrote it.

    Returns the greatest difference of probabilities over `SHAPES`. Raises BadInputError when the extra ``export`` is not
    installed or the file cannot be written, RuntimeError when the two disagree.
    """
    require_export_extra()
    network = network.eval().cpu()
    model = onnx_model(network, selector)
    difference = max_difference(network, model, SHAPES, selector.recalibration)
    if not difference <= TOLERANCE:
        raise RuntimeError(
            f"ONNX Runtime's probabilities differ from PyTorch's by {difference:.1e}; nothing was written"
        )
    write_whole(path, model)
    return difference


def require_export_extra() -> None:
    """Raises BadInputError when one of the packages of the extra ``export`` is missing."""
    missing = [name for name in ("onnx", "onnxscript", "onnxruntime") if importlib.util.find_spec(name) is None]
    if missing:
        raise BadInputError(f"format=onnx needs {', '.join(missing)}: install them with pip install 'sips_lit[export]'")


def onnx_model(network: ScoreNetwork, selector: PointSelector) -> bytes:
    """The serialised model, checked by ONNX itself."""
    import onnx

    # 2 x 2 x ... : an example size of 1 would be taken for a constant
    example = torch.zeros(2, 1, 4 * network.radius, 4 * network.radius + 2)
    sizes = {0: torch.export.Dim("batch"), 2: torch.export.Dim("height"), 3: torch.export.Dim("width")}
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it warns that torchvision is not installed
    with torch.no_grad(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            nn.Sequential(OrderedDict(network=network, probability=_Probability(selector.recalibration))).eval(),
            (example,),
            dynamo=True,
            dynamic_shapes=(sizes,),
            input_names=["image"],
            output_names=["probability"],
            verbose=False,
        )
    if program is None:
        raise RuntimeError("the exporter gave no model")
    model: Any = program.model_proto
    graph = model.graph
    for item in [*graph.node, *graph.input, *graph.output, *graph.value_info, *graph.initializer, graph]:
        del item.metadata_props[:]  # stack traces with the paths of this machine, several times the size of the rest
    model.doc_string = DESCRIPTION
    model.producer_name, model.producer_version = "sips_lit", version("sips_lit")
    onnx.helper.set_model_props(
        model, {METADATA_KEY: config_json(network, selector), "sips_lit_version": version("sips_lit")}
    )
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString())


class _Probability(nn.Module):
    def __init__(self, recalibration: Recalibration) -> None:
        super().__init__()
        self.recalibration = recalibration

    def forward(self, logits: Tensor) -> Tensor:
        if self.recalibration != AS_TRAINED:
            logits = self.recalibration.logits(logits)
        return torch.sigmoid(logits)


def max_difference(
    network: ScoreNetwork,
    model: bytes,
    shapes: Sequence[tuple[int, int, int, int]],
    recalibration: Recalibration = AS_TRAINED,
) -> float:
    """The greatest difference between PyTorch's and ONNX Runtime's probabilities on random images of these shapes."""
    import onnxruntime

    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    generator = np.random.default_rng(0)
    differences = []
    for shape in shapes:
        image = generator.integers(0, 256, shape).astype(np.float32)
        with torch.no_grad():
            expected = torch.sigmoid(recalibration.logits(network(torch.from_numpy(image)))).numpy()
        differences.append(float(np.abs(session.run(["probability"], {"image": image})[0] - expected).max()))
    return float(np.max(differences))  # NaN if one is

"""A score network as an ONNX graph, written node by node from the weights in memory: what other runtimes execute.

Unlike `sips_lit.export` it makes no file for others: logits instead of probabilities, and blocks of pixels where they are
faster.
"""

from __future__ import annotations

from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, nn

from sips_lit.detect.folding import block_side, folded_filters, folded_weight
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.errors import import_extra

EXTRA: Final = "runtimes"
_OPSET, _IR_VERSION = 18, 9  # understood by runtimes since 2023


def onnx_graph(network: ScoreNetwork) -> bytes:
    """A serialised model: ``image`` (B, 1, H, W) float32, 0 to 255, to ``logits`` (B, 1, H, W) float32.

    Any B, and any H and W that are whole blocks (see `sips_lit.detect.folding.whole_blocks`); a level of the pyramid, and an
    octave, at a time. Raises BadInputError when the package onnx is not installed.
    """
    onnx = import_extra("onnx", EXTRA, "a runtime other than torch")
    graph = _Graph(onnx)
    side, radius = block_side(network), network.radius
    x = graph.add("Div", graph.add("Sub", "image", graph.constant(np.float32(127))), graph.constant(np.float32(64)))
    x = graph.add("Pad", x, graph.constant(np.array([0, 0, radius, radius] * 2)), mode="edge")
    if network.derivatives:
        x = _derivative_channels(graph, x, folded_filters(cast(Tensor, network.filters), side), side)
    elif side > 1:
        x = graph.add("SpaceToDepth", x, blocksize=side)
    *hidden, last = cast("list[nn.Conv2d]", list(network.layers))
    for layer in hidden:
        x = graph.add("LeakyRelu", _layer(graph, x, layer, side), alpha=network.leaky_slope)
    x = _layer(graph, x, last, side)
    if side > 1:
        x = graph.add("DepthToSpace", x, blocksize=side, mode="CRD")
    return graph.serialised(x)


class _Graph:
    """Nodes and constants, each named by its number."""

    def __init__(self, onnx: Any) -> None:
        self.onnx, self.nodes, self.constants = onnx, list[Any](), list[Any]()

    def constant(self, values: NDArray[Any] | np.generic) -> str:
        name = f"constant{len(self.constants)}"
        self.constants.append(self.onnx.numpy_helper.from_array(np.ascontiguousarray(values), name))
        return name

    def add(self, operation: str, *inputs: str, **attributes: Any) -> str:
        (output,) = self.split(operation, 1, *inputs, **attributes)
        return output

    def split(self, operation: str, outputs: int, *inputs: str, **attributes: Any) -> list[str]:
        names = [f"{operation}{len(self.nodes)}_{index}" for index in range(outputs)]
        self.nodes.append(self.onnx.helper.make_node(operation, inputs, names, **attributes))
        return names

    def serialised(self, output: str) -> bytes:
        helper, kind = self.onnx.helper, self.onnx.TensorProto.FLOAT
        self.nodes.append(helper.make_node("Identity", [output], ["logits"]))
        ends = [helper.make_tensor_value_info(name, kind, ["B", 1, "H", "W"]) for name in ("image", "logits")]
        graph = helper.make_graph(self.nodes, "score_network", ends[:1], ends[1:], self.constants)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_IR_VERSION)
        return bytes(model.SerializeToString())


def _layer(graph: _Graph, x: str, layer: nn.Conv2d, side: int) -> str:
    weight = folded_weight(layer.weight, side).detach().cpu().numpy()
    bias = cast(Tensor, layer.bias).repeat_interleave(side**2).detach().cpu().numpy()
    return graph.add("Conv", x, graph.constant(weight), graph.constant(bias))


def _derivative_channels(graph: _Graph, x: str, filters: Tensor, side: int) -> str:
    """See `sips_lit.detect.derivatives.mixed_channels`."""

    def times(a: str, b: str) -> str:
        return graph.add("Mul", a, b)

    filtered = graph.add("Conv", x, graph.constant(filters.cpu().numpy()), strides=[side, side])
    grey, dx, dy, dxx, dyy, dxy = graph.split("Split", 6, filtered, axis=1, num_outputs=6)
    determinant = graph.add("Sub", times(dxx, dyy), times(dxy, dxy))
    products = graph.add("Concat", times(dx, dx), times(dy, dy), times(dx, dy), determinant, axis=1)
    one = graph.constant(np.float32(1))
    logarithm = graph.add("Log", graph.add("Add", graph.add("Abs", products), one))
    return graph.add("Concat", grey, dx, dy, times(graph.add("Sign", products), logarithm), axis=1)

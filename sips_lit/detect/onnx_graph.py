"""A score network as an ONNX graph, written node by node from the weights in memory: what other runtimes execute.

Unlike `sips_lit.export` it makes no file for others: logits instead of probabilities, and blocks of pixels where they are
faster.
"""

from __future__ import annotations

from typing import Any, Final, cast

import numpy as np
import torch
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
    first, *hidden, last = cast("list[nn.Conv2d]", list(network.layers))
    if network.derivatives:
        x = _first_layer_of_derivatives(graph, x, network, side)
    else:
        x = _layer(graph, graph.add("SpaceToDepth", x, blocksize=side) if side > 1 else x, first, side)
    for layer in hidden:
        x = _layer(graph, graph.add("LeakyRelu", x, alpha=network.leaky_slope), layer, side)
    x = graph.add("LeakyRelu", x, alpha=network.leaky_slope)
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
    return graph.add("Conv", x, graph.constant(weight), graph.constant(_bias(layer, side)))


def _bias(layer: nn.Conv2d, side: int) -> NDArray[np.float32]:
    bias: NDArray[np.float32] = cast(Tensor, layer.bias).repeat_interleave(side**2).detach().cpu().numpy()
    return bias


def _first_layer_of_derivatives(graph: _Graph, x: str, network: ScoreNetwork, side: int) -> str:
    """The first layer on `sips_lit.detect.derivatives.mixed_channels`, without parts of tensors, which runtimes copy.

    Each factor of the products is a convolution of its own, and the layer is the sum of two, of the linear channels and of
    the products.
    """
    grey, dx, dy, dxx, dyy, dxy = folded_filters(cast(Tensor, network.filters), side).chunk(6)
    none = torch.zeros_like(grey)

    def filtered(*filters: Tensor) -> str:
        return graph.add("Conv", x, graph.constant(torch.cat(filters).cpu().numpy()), strides=[side, side])

    linear = filtered(grey, dx, dy)
    ahead, behind, mixed = filtered(dx, dy, dx, dxx), filtered(dx, dy, dy, dyy), filtered(none, none, none, dxy)
    products = graph.add("Sub", graph.add("Mul", ahead, behind), graph.add("Mul", mixed, mixed))
    size = graph.add("Abs", products)
    sign = graph.add("Div", products, graph.add("Max", size, graph.constant(np.float32(1e-30))))
    logarithm = graph.add("Log", graph.add("Add", size, graph.constant(np.float32(1))))
    layer = cast("nn.Conv2d", network.layers[0])
    weight, linear_channels = folded_weight(layer.weight, side).detach().cpu().numpy(), 3 * side**2
    weights = [graph.constant(weight[:, :linear_channels]), graph.constant(weight[:, linear_channels:])]
    bias = graph.constant(_bias(layer, side))
    first = graph.add("Conv", linear, weights[0], bias)
    return graph.add("Add", graph.add("Conv", graph.add("Mul", sign, logarithm), weights[1]), first)

import numpy as np
import onnx
import pytest
import torch
from onnx.reference import ReferenceEvaluator

from sips_lit.detect.onnx_graph import onnx_graph
from sips_lit.detect.score_network import ScoreNetwork


@pytest.mark.parametrize(
    "options", [{"width": 8, "derivatives": True}, {"width": 4}, {"width": 10, "derivatives": True}]
)
@pytest.mark.parametrize("shape", [(2, 1, 10, 14), (1, 1, 2, 2)])
def test_the_graph_gives_the_logits_of_the_network(options, shape):
    """By ONNX's own evaluator, which is none of the runtimes."""
    torch.manual_seed(0)
    network, image = ScoreNetwork(depth=3, **options).eval(), 255 * torch.rand(shape)
    (logits,) = ReferenceEvaluator(onnx_graph(network)).run(["logits"], {"image": image.numpy()})
    with torch.no_grad():
        np.testing.assert_allclose(logits, network(image).numpy(), atol=1e-5)


def test_an_image_without_derivatives_has_logits():
    torch.manual_seed(0)
    network, image = ScoreNetwork(depth=3, width=8, derivatives=True).eval(), torch.full((1, 1, 10, 14), 77.0)
    (logits,) = ReferenceEvaluator(onnx_graph(network)).run(["logits"], {"image": image.numpy()})
    with torch.no_grad():
        np.testing.assert_allclose(logits, network(image).numpy(), atol=1e-5)


def test_the_graph_is_legal_and_takes_any_size():
    model = onnx.load_from_string(onnx_graph(ScoreNetwork(4, 8, derivatives=True)))
    onnx.checker.check_model(model, full_check=True)
    assert [d.dim_param or d.dim_value for d in model.graph.input[0].type.tensor_type.shape.dim] == ["B", 1, "H", "W"]

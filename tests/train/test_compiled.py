from functools import partial

import pytest
import torch
from textured_scenes import texture
from train_run import fit, make_data, make_module

from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import image_tensor
from sips_lit.errors import BadInputError
from sips_lit.train.compiled import compile_layers


class Traced:
    """In place of Inductor, which takes a minute: runs the graphs as they were traced, and counts them."""

    def __init__(self) -> None:
        self.graphs = 0

    def __call__(self, graph, example_inputs):
        self.graphs += 1
        return graph.forward


@pytest.fixture
def backend(monkeypatch) -> Traced:
    traced = Traced()
    monkeypatch.setattr(torch, "compile", partial(torch.compile, backend=traced))
    torch.compiler.reset()
    yield traced
    torch.compiler.reset()


def test_a_compiled_run_learns_the_same_and_its_checkpoint_is_like_any_other(tmp_path, backend):
    plain, compiled = make_module(), make_module(compiled=True)
    fit(plain, make_data(tmp_path), steps=2)
    assert backend.graphs == 0
    trainer = fit(compiled, make_data(tmp_path), steps=2)
    assert backend.graphs >= 2, "with a gradient for the loss, without one for the selection"
    expected, learned = plain.state_dict(), compiled.state_dict()
    assert list(learned) == list(expected)
    for name, weights in expected.items():
        torch.testing.assert_close(learned[name], weights, rtol=0, atol=1e-5)
    trainer.save_checkpoint(tmp_path / "a.ckpt")
    stored = torch.load(tmp_path / "a.ckpt", weights_only=True)
    assert not [name for name in stored["state_dict"] if "_orig_mod" in name]
    detector = SipsDetector.from_checkpoint(tmp_path / "a.ckpt")
    image = texture(60, 70, 4)
    found = SipsDetector(compiled.network, compiled.selector).detect(image, 20)
    assert (detector.detect(image, 20).xy == found.xy).all()


@pytest.mark.parametrize(
    "options", [{}, {"derivatives": True}, {"octaves": 2, "corners": 0.5}], ids=["plain", "derivatives", "octaves"]
)
@pytest.mark.parametrize("gradient", ["patches", "dense"])
def test_logits_and_gradients_are_those_of_the_network(backend, options, gradient):
    network = ScoreNetwork(4, 8, **options)
    rows, columns = torch.tensor([0, 3, 30, 59]), torch.tensor([0, 50, 8, 69])
    found = []
    for _ in range(2):
        network.zero_grad()
        (logits,) = network.at([image_tensor(texture(60, 70))], [(rows, columns)], gradient)
        logits.square().sum().backward()
        found.append([logits.detach(), *(weights.grad.clone() for weights in network.parameters())])
        compile_layers(network)
    assert backend.graphs > 0
    for expected, compiled in zip(*found, strict=True):
        torch.testing.assert_close(compiled, expected, rtol=1e-5, atol=1e-5)


def test_without_a_compiler_it_is_said_before_a_run(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CXX", raising=False)
    with pytest.raises(BadInputError, match=r"module.compiled=true needs a C\+\+ compiler"):
        make_module(compiled=True)
    monkeypatch.setenv("CXX", "/bin/sh")
    make_module(compiled=True)

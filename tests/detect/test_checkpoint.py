import json
from pathlib import Path
from typing import Any

import pytest
import safetensors.torch
import torch
from tiny_network import lightning_content, save_lightning, tiny_network

from sips_lit.detect.checkpoint import METADATA_KEY, load_checkpoint
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.export.safetensors import export_safetensors

SELECTOR = PointSelector(4, subpixel=False)
Content = dict[str, Any]


def refused(path: Path) -> str:
    """The sentence that a file is refused with, which names it."""
    with pytest.raises(BadInputError) as caught:
        load_checkpoint(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.fixture
def content() -> Content:
    return lightning_content(tiny_network(), SELECTOR)


@pytest.mark.parametrize("parameters", [{}, {"scales": 3, "scale_factor": 1.3}, {"leaky_slope": 0.2}])
@pytest.mark.parametrize("suffix", [".ckpt", ".safetensors"])
def test_what_was_saved_comes_back(tmp_path, suffix, parameters):
    network, path = tiny_network(5, **parameters), tmp_path / f"best{suffix}"
    if suffix == ".ckpt":
        save_lightning(path, network, SELECTOR)
    else:
        export_safetensors(network, SELECTOR, path)
    loaded, selector = load_checkpoint(str(path))
    assert selector == SELECTOR
    assert loaded.config == network.config
    assert not loaded.training
    image = 255 * torch.rand(1, 1, 20, 30)
    with torch.no_grad():
        assert torch.equal(loaded(image), network(image))


@pytest.mark.parametrize("name", ["gone.ckpt", "gone.safetensors", ""])
def test_missing(tmp_path, name):
    assert "there is no checkpoint" in refused(tmp_path / name)


@pytest.mark.parametrize("suffix", [".ckpt", ".safetensors"])
@pytest.mark.parametrize("damage", [b"", b"not a checkpoint", b"\x80\x02]q\x00.", "truncated"])
def test_damaged(tmp_path, suffix, damage):
    path = tmp_path / f"best{suffix}"
    if suffix == ".ckpt":
        save_lightning(path, tiny_network(), SELECTOR)
    else:
        export_safetensors(tiny_network(), SELECTOR, path)
    path.write_bytes(path.read_bytes()[:-200] if damage == "truncated" else damage)
    assert "damaged" in refused(path)


def test_a_single_bit_of_the_weights(tmp_path):
    """Which PyTorch loads without a word."""
    path, network = tmp_path / "best.ckpt", tiny_network()
    save_lightning(path, network, SELECTOR)
    content = bytearray(path.read_bytes())
    content[content.find(next(network.parameters()).detach().numpy().tobytes()) + 3] ^= 64
    path.write_bytes(content)
    torch.load(path, weights_only=True)
    assert "damaged" in refused(path)


def test_code_is_not_run(tmp_path, content):
    class Trap:
        def __reduce__(self) -> Any:
            return Path.touch, (tmp_path / "sprung",)

    torch.save({**content, "trap": Trap()}, tmp_path / "trap.ckpt")
    assert "can't be read" in refused(tmp_path / "trap.ckpt")
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize("foreign", [{"layer.weight": torch.zeros(3)}, [1, 2], torch.zeros(4), {"state_dict": 5}])
def test_of_another_program(tmp_path, foreign):
    torch.save(foreign, tmp_path / "foreign.ckpt")
    assert "not one of sips-train" in refused(tmp_path / "foreign.ckpt")


@pytest.mark.parametrize(
    "hyper_parameters",
    [
        {},
        {"network": {}},
        {"network": {"layers": 18}, "selector": {}},
        {"network": {"depth": 1}, "selector": {}},
        {"network": {"depth": 3, "width": 4}, "selector": {"nms_radius": -2}},
        {"network": {"depth": 3, "width": 4}, "selector": {"radius": 2}},
        {"network": {"depth": "three"}, "selector": {}},
        {"network": None, "selector": None},
        [1],
        "text",
        None,
    ],
)
def test_of_another_configuration(tmp_path, content, hyper_parameters):
    torch.save({**content, "hyper_parameters": hyper_parameters}, tmp_path / "x.ckpt")
    assert "not a checkpoint of a sips_lit score network" in refused(tmp_path / "x.ckpt")


@pytest.mark.parametrize("change", ["deeper", "wider", "missing", "more"])
def test_weights_that_do_not_fit(tmp_path, content, change):
    if change in ("deeper", "wider"):
        content["hyper_parameters"]["network"]["depth" if change == "deeper" else "width"] = 8
    elif change == "missing":
        del content["state_dict"]["network.layers.1.bias"]
    else:
        content["state_dict"]["network.layers.9.bias"] = torch.zeros(1)
    torch.save(content, tmp_path / "x.ckpt")
    assert "use one of sips-train" in refused(tmp_path / "x.ckpt")


@pytest.mark.parametrize("metadata", [None, {"other": "x"}, {METADATA_KEY: "{"}, {METADATA_KEY: "[]"}])
def test_safetensors_of_another_program(tmp_path, metadata):
    safetensors.torch.save_file({"weight": torch.zeros(2)}, tmp_path / "x.safetensors", metadata)
    refused(tmp_path / "x.safetensors")


def test_safetensors_with_other_weights(tmp_path):
    config = json.dumps({"network": tiny_network().config, "selector": {}})
    safetensors.torch.save_file({"weight": torch.zeros(2)}, tmp_path / "x.safetensors", {METADATA_KEY: config})
    assert "not a checkpoint of a sips_lit score network" in refused(tmp_path / "x.safetensors")

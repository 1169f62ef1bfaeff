import json
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.torch
import torch
from textured_scenes import texture
from tiny_network import lightning_content, save_lightning, tiny_network

from sips_lit.archives import zip_members
from sips_lit.detect.checkpoint import (
    METADATA_KEY,
    config_json,
    digest_of,
    export_safetensors,
    load_checkpoint,
    load_network,
    start_from,
)
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.recalibration import Recalibration
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError

SELECTOR = PointSelector(4, subpixel=False)
Content = dict[str, Any]
IMAGE = texture(61, 83)


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
        {"network": {"depth": 10**6, "width": 4}, "selector": {}},
        {"network": {"depth": 3, "width": 10**6}, "selector": {}},
        {"network": {"depth": 3, "width": 4, "scales": 10**9}, "selector": {}},
        {"network": {"depth": 3, "width": 4}, "selector": {"nms_radius": 1.5}},
        {"network": {"depth": 3, "width": 4}, "selector": {"nms_radius": 10**9}},
        [1],
        "text",
        None,
    ],
)
def test_of_another_configuration(tmp_path, content, hyper_parameters):
    torch.save({**content, "hyper_parameters": hyper_parameters}, tmp_path / "x.ckpt")
    assert "not a checkpoint of a sips_lit score network" in refused(tmp_path / "x.ckpt")


@pytest.mark.parametrize("weights", [5, {5: torch.zeros(1)}, {"network.layers.0.bias": "text"}])
def test_a_state_that_is_none(tmp_path, content, weights):
    torch.save({**content, "state_dict": weights}, tmp_path / "x.ckpt")
    assert "not one of sips-train" in refused(tmp_path / "x.ckpt")


def test_a_file_that_unpacks_to_more_than_there_can_be(tmp_path, content, monkeypatch):
    """Packed anew it is read; zeros in the place of a weight are small in the file only."""
    torch.save(content, tmp_path / "whole.ckpt")
    monkeypatch.setattr(zip_members, "LARGEST", 10**6)
    for name, more in (("packed", 0), ("bomb", 10**6)):
        with (
            zipfile.ZipFile(tmp_path / "whole.ckpt") as whole,
            zipfile.ZipFile(tmp_path / f"{name}.ckpt", "w", 8) as file,
        ):
            for member in whole.namelist():
                file.writestr(member, whole.read(member) + bytes(more * member.endswith("data/0")))
    load_checkpoint(tmp_path / "packed.ckpt")
    assert "can't be read" in refused(tmp_path / "bomb.ckpt")


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


@pytest.mark.parametrize(
    "metadata", [None, {"other": "x"}, {METADATA_KEY: "{"}, {METADATA_KEY: "[]"}, {METADATA_KEY: "[" * 10**5}]
)
def test_safetensors_of_another_program(tmp_path, metadata):
    safetensors.torch.save_file({"weight": torch.zeros(2)}, tmp_path / "x.safetensors", metadata)
    refused(tmp_path / "x.safetensors")


def test_safetensors_with_other_weights(tmp_path):
    config = json.dumps({"network": tiny_network().config, "selector": {}})
    safetensors.torch.save_file({"weight": torch.zeros(2)}, tmp_path / "x.safetensors", {METADATA_KEY: config})
    assert "not a checkpoint of a sips_lit score network" in refused(tmp_path / "x.safetensors")


def make_network(scales: int = 1) -> ScoreNetwork:
    torch.manual_seed(1)
    return ScoreNetwork(3, 4, leaky_slope=0.03, scales=scales)


@pytest.mark.parametrize("scales", [1, 3])
def test_scores_and_points_come_back_identical(tmp_path, scales):
    before = SipsDetector(make_network(scales), PointSelector(4))
    export_safetensors(before.network, before.selector, tmp_path / "a.safetensors")
    after = SipsDetector.from_checkpoint(tmp_path / "a.safetensors")
    assert after.selector == before.selector
    np.testing.assert_array_equal(after.score_map(IMAGE), before.score_map(IMAGE))
    for name in ("xy", "score", "scale"):
        np.testing.assert_array_equal(getattr(after(IMAGE, 30), name), getattr(before(IMAGE, 30), name))


def test_the_selection_is_kept(tmp_path):
    selector = PointSelector(9, subpixel=False)
    export_safetensors(make_network(), selector, tmp_path / "a.safetensors")
    assert load_checkpoint(tmp_path / "a.safetensors")[1] == selector


def test_two_files_that_others_can_read(tmp_path):
    written = export_safetensors(make_network(), PointSelector(4), tmp_path / "a.safetensors")
    assert written == [tmp_path / "a.safetensors", tmp_path / "a.json"]
    assert sorted(tmp_path.iterdir()) == sorted(written)
    beside = json.loads(written[1].read_text())
    assert beside == json.loads(config_json(make_network(), PointSelector(4)))
    assert beside["selector"] == {"nms_radius": 4, "subpixel": True, "border": 0}
    assert ScoreNetwork(**beside["network"]).config == make_network().config
    with safetensors.safe_open(written[0], framework="numpy") as stored:
        assert json.loads(stored.metadata()[METADATA_KEY]) == beside
        for name, tensor in make_network().state_dict().items():
            np.testing.assert_array_equal(stored.get_tensor(name), tensor.numpy())


def test_the_same_network_gives_the_same_bytes(tmp_path):
    for name in "ab":
        export_safetensors(make_network(), PointSelector(), tmp_path / f"{name}.safetensors")
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()


def test_an_export_replaces_the_one_before(tmp_path):
    path = tmp_path / "a.safetensors"
    export_safetensors(make_network(3), PointSelector(), path)
    export_safetensors(make_network(), PointSelector(2), path)
    assert load_checkpoint(path)[0].scales == 1
    assert json.loads((tmp_path / "a.json").read_text())["selector"]["nms_radius"] == 2


def test_what_cannot_be_written(tmp_path):
    with pytest.raises(BadInputError, match=r"cannot write .*a\.safetensors"):
        export_safetensors(make_network(), PointSelector(), tmp_path / "gone" / "a.safetensors")


def test_a_network_starts_from_the_weights_of_another(tmp_path):
    path, network = tmp_path / "a.safetensors", tiny_network(1, start_bias=-3.0)
    export_safetensors(tiny_network(2), PointSelector(), path)
    assert digest_of(network) != digest_of(load_network(path))
    start_from(network, path)
    assert digest_of(network) == digest_of(load_network(path)) == digest_of(tiny_network(2))
    detecting_otherwise = tiny_network(1, octaves=2, corners=0.5)
    start_from(detecting_otherwise, path)
    assert digest_of(detecting_otherwise) == digest_of(tiny_network(2, octaves=2, corners=0.5))


@pytest.mark.parametrize("other", [{"scales": 2}, {"derivatives": True}, {"leaky_slope": 0.1}])
def test_a_start_of_another_architecture_is_refused(tmp_path, other):
    path, network = tmp_path / "a.safetensors", tiny_network()
    export_safetensors(tiny_network(**other), PointSelector(), path)
    before = digest_of(network)
    ((name, value),) = other.items()
    with pytest.raises(
        BadInputError, match=rf"a\.safetensors is another network, with {name}={value} \(here .*same model"
    ):
        start_from(network, path)
    assert digest_of(network) == before


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_weights_that_are_not_finite_are_no_start(tmp_path, value):
    network = tiny_network()
    with torch.no_grad():
        network.layers[1].bias[0] = value
    export_safetensors(network, PointSelector(), tmp_path / "a.safetensors")
    with pytest.raises(BadInputError, match="weights that are not finite"):
        load_network(tmp_path / "a.safetensors")


def test_a_digest_tells_the_weights_and_what_the_network_makes_of_them():
    digests = [
        digest_of(tiny_network()),
        digest_of(tiny_network(1)),
        digest_of(tiny_network(leaky_slope=0.1)),
        digest_of(tiny_network(octaves=2)),
        digest_of(tiny_network(corners=0.5)),
        digest_of(tiny_network(first_octave=1)),
        digest_of(tiny_network(octaves=2, octave_step=0.5)),
        digest_of(tiny_network(fine_corners=0.5)),
    ]
    assert len({*digests, digest_of(tiny_network())}) == 8


@pytest.mark.parametrize("suffix", [".ckpt", ".safetensors"])
def test_a_recalibration_comes_back_and_is_used(tmp_path, content, suffix):
    recalibration = Recalibration(0.7, -0.5, 0.25, 1.25)
    selector, path = replace(SELECTOR, recalibration=recalibration), tmp_path / f"a{suffix}"
    if suffix == ".ckpt":
        content["hyper_parameters"]["recalibration"] = recalibration.config
        torch.save(content, path)
    else:
        export_safetensors(tiny_network(), selector, path)
        stored = json.loads(path.with_suffix(".json").read_text())
        assert stored["recalibration"] == recalibration.config
        assert stored["selector"] == SELECTOR.config
    network, loaded = load_checkpoint(path)
    assert loaded == selector
    detector = SipsDetector.from_checkpoint(path)
    assert detector.recalibration == recalibration
    given = SipsDetector(network, replace(selector, subpixel=True))(IMAGE, 20)
    np.testing.assert_array_equal(detector(IMAGE, 20).score, given.score)


@pytest.mark.parametrize("wrong", [{"scale": -1.0}, {"scale": "x"}, {"steps": 3}, {"difficulty": float("nan")}, 5])
def test_a_recalibration_that_can_not_be(tmp_path, content, wrong):
    content["hyper_parameters"]["recalibration"] = wrong
    torch.save(content, tmp_path / "x.ckpt")
    assert "is not a checkpoint of a sips_lit score network" in refused(tmp_path / "x.ckpt")


def test_without_a_recalibration_none_is_stored():
    assert "recalibration" not in json.loads(config_json(tiny_network(), SELECTOR))

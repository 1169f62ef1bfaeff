import json

import numpy as np
import pytest
import safetensors
import torch
from textured_scenes import texture

from sips_lit.detect.checkpoint import METADATA_KEY, load_checkpoint
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.export.safetensors import config_json, export_safetensors

IMAGE = texture(61, 83)


def network(scales: int = 1) -> ScoreNetwork:
    torch.manual_seed(1)
    return ScoreNetwork(3, 4, leaky_slope=0.03, scales=scales)


@pytest.mark.parametrize("scales", [1, 3])
def test_scores_and_points_come_back_identical(tmp_path, scales):
    before = SipsDetector(network(scales), PointSelector(4))
    export_safetensors(before.network, before.selector, tmp_path / "a.safetensors")
    after = SipsDetector.from_checkpoint(tmp_path / "a.safetensors")
    assert after.selector == before.selector
    np.testing.assert_array_equal(after.score_map(IMAGE), before.score_map(IMAGE))
    for name in ("xy", "score", "scale"):
        np.testing.assert_array_equal(getattr(after(IMAGE, 30), name), getattr(before(IMAGE, 30), name))


def test_the_selection_is_kept(tmp_path):
    selector = PointSelector(9, subpixel=False)
    export_safetensors(network(), selector, tmp_path / "a.safetensors")
    assert load_checkpoint(tmp_path / "a.safetensors")[1] == selector


def test_two_files_that_others_can_read(tmp_path):
    written = export_safetensors(network(), PointSelector(4), tmp_path / "a.safetensors")
    assert written == [tmp_path / "a.safetensors", tmp_path / "a.json"]
    assert sorted(tmp_path.iterdir()) == sorted(written)
    beside = json.loads(written[1].read_text())
    assert beside == json.loads(config_json(network(), PointSelector(4)))
    assert beside["selector"] == {"nms_radius": 4, "subpixel": True}
    assert ScoreNetwork(**beside["network"]).config == network().config
    with safetensors.safe_open(written[0], framework="numpy") as stored:
        assert json.loads(stored.metadata()[METADATA_KEY]) == beside
        for name, tensor in network().state_dict().items():
            np.testing.assert_array_equal(stored.get_tensor(name), tensor.numpy())


def test_the_same_network_gives_the_same_bytes(tmp_path):
    for name in "ab":
        export_safetensors(network(), PointSelector(), tmp_path / f"{name}.safetensors")
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()


def test_an_export_replaces_the_one_before(tmp_path):
    path = tmp_path / "a.safetensors"
    export_safetensors(network(3), PointSelector(), path)
    export_safetensors(network(), PointSelector(2), path)
    assert load_checkpoint(path)[0].scales == 1
    assert json.loads((tmp_path / "a.json").read_text())["selector"]["nms_radius"] == 2


def test_what_cannot_be_written(tmp_path):
    with pytest.raises(BadInputError, match=r"cannot write .*a\.safetensors"):
        export_safetensors(network(), PointSelector(), tmp_path / "gone" / "a.safetensors")

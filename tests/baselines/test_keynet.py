import numpy as np
import pytest
import torch
from detector_contract import check_contract, scene
from random_weights import weights_file

from sips_lit.baselines.keynet import KeyNet
from sips_lit.errors import BadInputError


@pytest.fixture
def detector(tmp_path):
    return KeyNet(weights=str(weights_file("keynet", tmp_path)))


def test_contract_with_random_weights(detector):
    check_contract(detector, None)


class Brightness(torch.nn.Module):
    """A response without a preferred direction, in place of the network's."""

    def forward(self, image):
        return image


@pytest.mark.parametrize("size", [(150, 190), (141, 187)])
def test_no_offset_on_any_level(detector, size):
    """Points of an image turned by 180 degrees, turned back, lie on those of the image."""
    detector.network.model = Brightness()
    image = scene(*size)
    here, there = detector.detect(image, 5000), detector.detect(np.ascontiguousarray(image[::-1, ::-1]), 5000)
    back = np.array([size[1] - 1, size[0] - 1]) - there.xy
    levels = np.unique(here.scale)
    assert len(levels) >= 3
    for level in levels:
        mine, other = here.xy[here.scale == level], back[there.scale == level]
        apart = mine[:, None] - other
        error = apart[np.arange(len(mine)), np.abs(apart).sum(axis=2).argmin(axis=1)]
        assert np.abs(np.median(error, axis=0)).max() < 0.02


def test_without_weights_it_says_where_to_get_them(monkeypatch, tmp_path):
    pytest.importorskip("kornia.feature")
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    with pytest.raises(BadInputError, match=r"keynet_pytorch\.pth .*detector\.weights"):
        KeyNet()
    (tmp_path / "checkpoints").mkdir()
    weights_file("keynet", tmp_path).rename(tmp_path / "checkpoints" / "keynet_pytorch.pth")
    assert len(KeyNet().detect(scene(90, 120), 5)) == 5

import numpy as np
import pytest
from textured_scenes import keypoints

from sips_lit.baselines.precomputed import HlocFile
from sips_lit.errors import BadInputError
from sips_lit.formats.hloc import HlocFeatures
from sips_lit.types import Keypoints

h5py = pytest.importorskip("h5py", reason="it writes hloc's files: pip install h5py")

POINTS = keypoints([[1 / 3, 20.1], [30, 7.7777777]], [0.1, 1e-7], 2**0.5)
ROWS = np.random.default_rng(0).random((2, 128), np.float32)


def test_a_group_an_image(tmp_path):
    path = tmp_path / "new" / "features.h5"
    with HlocFeatures(path) as file:
        file.add("cam/a.png", (64, 48), POINTS, ROWS)
        file.add("b.png", (5, 9), Keypoints.empty(), np.zeros((0, 128), np.float32))
        file.add("c.png", (5, 9), POINTS)
        assert file.images == 3
        assert not path.exists()
    assert [entry.name for entry in path.parent.iterdir()] == ["features.h5"]
    file.close()
    with h5py.File(path) as held:
        group = held["cam"]["a.png"]
        assert sorted(group) == ["descriptors", "image_size", "keypoints", "scales", "scores"]
        np.testing.assert_array_equal(group["keypoints"], POINTS.xy)
        np.testing.assert_array_equal(group["scores"], POINTS.score)
        np.testing.assert_array_equal(group["scales"], POINTS.scale)
        np.testing.assert_array_equal(group["descriptors"], ROWS.T)
        np.testing.assert_array_equal(group["image_size"], [64, 48])
        assert held["b.png"]["descriptors"].shape == (128, 0)
        assert "descriptors" not in held["c.png"]
    read = HlocFile(path)
    assert read.names == {"cam/a.png", "b.png", "c.png"}


def test_names_are_given_once(tmp_path):
    with HlocFeatures(tmp_path / "features.h5") as file:
        file.add("a.png", (64, 48), POINTS)
        with pytest.raises(BadInputError, match=r"has features of a\.png already"):
            file.add("a.png", (64, 48), POINTS)


def test_without_h5py(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    with pytest.raises(BadInputError, match=r"needs the package h5py: pip install 'sips_lit\[formats\]'"):
        HlocFeatures(tmp_path / "features.h5")
    assert not list(tmp_path.iterdir())

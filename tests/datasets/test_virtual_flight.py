from pathlib import Path

import cv2
import numpy as np
import pytest
from textured_scenes import texture

from sips_lit.datasets.layered_flight import LayeredFlight
from sips_lit.datasets.virtual_flight import flights_over, virtual_flight
from sips_lit.errors import BadInputError
from sips_lit.files import safe_name

SIZE = (160, 120)
STILL = texture(400, 600)


def test_files_and_folders(tmp_path: Path):
    for name in ("b c.png", "a.png", "a.bmp"):
        cv2.imwrite(str(tmp_path / name), texture(90, 120, len(name)))
    (tmp_path / "notes.txt").touch()
    names = [flight.name for flight in virtual_flight(tmp_path, SIZE, 5, 2)]
    assert len(set(names)) == 6
    assert names[-2:] == ["b_c_flight0", "b_c_flight1"]
    assert all(name == safe_name(name) for name in names)
    (single,) = virtual_flight(str(tmp_path / "a.bmp"), SIZE, 5, 1, seed=3)
    (expected,) = flights_over([("a", texture(90, 120, 5))], SIZE, 5, 1, seed=3)
    np.testing.assert_array_equal(single.frame(4), expected.frame(4))
    assert (len(single), single.name) == (5, "a_flight0")


def test_bad_input(tmp_path: Path):
    with pytest.raises(BadInputError, match=r"no image or folder .*gone"):
        virtual_flight(tmp_path / "gone")
    with pytest.raises(BadInputError, match="no photographs"):
        virtual_flight(tmp_path)
    (tmp_path / "notes.txt").write_text("no image")
    with pytest.raises(BadInputError, match=r"notes\.txt is not an image"):
        virtual_flight(tmp_path / "notes.txt")
    with pytest.raises(BadInputError, match="no photographs"):
        flights_over([])
    with pytest.raises(BadInputError, match="photograph tiny is 100x31: too small"):
        flights_over([("tiny", np.zeros((31, 100), np.uint8))])


@pytest.mark.parametrize(
    "numbers", [{"size": (15, 100)}, {"size": (100, 0)}, {"length": 1}, {"flights_per_still": 0}, {"seed": -1}]
)
def test_numbers_out_of_range(numbers: dict[str, object]):
    with pytest.raises(BadInputError, match="flights need a size of at least 16x16"):
        flights_over([("still", STILL)], **numbers)


def test_layers_are_of_the_other_photographs(tmp_path: Path):
    for name, value in (("a", 40), ("b", 200)):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((120, 160), value, np.uint8))
    first, second = virtual_flight(tmp_path, SIZE, 3, 1, layers=2)
    assert isinstance(first, LayeredFlight)
    for flight, other in ((first, 200), (second, 40)):
        assert all(len(np.unique(layer.texture)) == 1 for layer in flight._layers)
        assert 1 <= len(flight._layers) <= 2
        assert all(0.5 * other - 40 <= layer.texture[0, 0] <= 1.1 * other + 40 for layer in flight._layers)

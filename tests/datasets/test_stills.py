import cv2
import numpy as np
import pytest
from textured_scenes import texture

from sips_lit.datasets.stills import stills
from sips_lit.errors import BadInputError


def test_all_images_below_a_folder_whatever_their_sizes(tmp_path):
    (tmp_path / "more").mkdir()
    images = {"a.png": texture(40, 60), "b.png": texture(90, 30, 1), "more/c.png": texture(200, 100, 2)}
    for name, image in images.items():
        cv2.imwrite(str(tmp_path / name), image)
    (tmp_path / "notes.txt").touch()
    (sequence,) = stills(tmp_path, max_side=100)
    assert (len(sequence), sequence.temporal) == (3, False)
    np.testing.assert_array_equal(sequence.frame(1), images["b.png"])
    assert sequence.frame(2).shape == (100, 50)
    assert sequence.frame_name(2) == "c"
    assert stills(tmp_path)[0].fingerprint != sequence.fingerprint == stills(tmp_path, 100)[0].fingerprint


def test_one_image_is_enough(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), texture(40, 60))
    assert len(stills(tmp_path)[0]) == 1


def test_no_images(tmp_path):
    with pytest.raises(BadInputError, match="has no images"):
        stills(tmp_path)
    with pytest.raises(BadInputError, match="there is no folder"):
        stills(tmp_path / "gone")
    (tmp_path / "bad.png").write_bytes(b"no image")
    with pytest.raises(BadInputError, match=r"bad\.png"):
        stills(tmp_path)[0].frame(0)

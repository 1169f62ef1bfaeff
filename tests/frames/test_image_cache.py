import numpy as np
import pytest

from sips_lit.errors import BadInputError
from sips_lit.frames.image_cache import image_cache


def counting(calls):
    def make():
        calls.append(1)
        return np.random.default_rng(0).integers(0, 256, (30, 41), np.uint8)

    return make


def test_an_image_is_made_once_and_read_after(tmp_path):
    calls = []
    for _ in range(3):
        image = image_cache(tmp_path, "a", "0123456789abcdef")("left", counting(calls))
        np.testing.assert_array_equal(image, counting([])())
    assert len(calls) == 1


def test_another_fingerprint_or_name_is_another_image(tmp_path):
    calls = []
    image_cache(tmp_path, "a", "0123456789")("left", counting(calls))
    image_cache(tmp_path, "a", "x123456789")("left", counting(calls))
    image_cache(tmp_path, "a", "0123456789")("right", counting(calls))
    assert len(calls) == 3


def test_a_damaged_image_is_made_anew(tmp_path):
    calls = []
    cache = image_cache(tmp_path, "a", "0123456789")
    cache("left", counting(calls))
    (file,) = tmp_path.glob("*/left.pgm")
    file.write_bytes(file.read_bytes()[:100])
    np.testing.assert_array_equal(cache("left", counting(calls)), counting([])())
    assert len(calls) == 2


def test_without_a_folder_nothing_is_kept(tmp_path):
    calls = []
    cache = image_cache(None, "a", "0")
    cache("left", counting(calls))
    cache("left", counting(calls))
    assert len(calls) == 2


def test_a_source_that_fails_leaves_nothing(tmp_path):
    def fail():
        raise BadInputError("damaged")

    with pytest.raises(BadInputError, match="damaged"):
        image_cache(tmp_path, "a", "0")("left", fail)
    assert not list(tmp_path.iterdir())

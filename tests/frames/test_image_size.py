import cv2
import numpy as np
import pytest

from sips_lit.errors import BadInputError
from sips_lit.frames.image_size import image_size


@pytest.mark.parametrize("suffix", ["ppm", "pgm", "png", "jpg", "bmp", "tif"])
@pytest.mark.parametrize("size", [(40, 30), (7, 256)])
def test_as_decoded(tmp_path, suffix, size):
    path = tmp_path / f"a.{suffix}"
    shape = size[::-1] if suffix == "pgm" else (*size[::-1], 3)
    cv2.imwrite(str(path), np.full(shape, 90, np.uint8))
    assert image_size(path) == size


def test_comments_in_a_header(tmp_path):
    path = tmp_path / "a.ppm"
    path.write_bytes(b"P6\n# made by hand 9 9\n# twice\n3\t2\n255\n" + bytes(18))
    assert image_size(path) == (3, 2)


def test_of_a_png_only_the_header_is_needed(tmp_path):
    path = tmp_path / "a.png"
    path.write_bytes(cv2.imencode(".png", np.zeros((20, 30), np.uint8))[1].tobytes()[:40])
    assert image_size(path) == (30, 20)


@pytest.mark.parametrize("content", [b"", b"P6", b"hello", b"\x89PNG\r\n\x1a\n"])
def test_no_image(tmp_path, content):
    path = tmp_path / "a.ppm"
    path.write_bytes(content)
    with pytest.raises(BadInputError, match=r"a\.ppm"):
        image_size(path)


def test_no_file(tmp_path):
    with pytest.raises(BadInputError, match=r"cannot read .*a\.ppm"):
        image_size(tmp_path / "a.ppm")

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image

from sips_lit.errors import BadInputError
from sips_lit.frames.image_size import first_size, image_size
from sips_lit.frames.images import read_grey


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


@pytest.mark.parametrize("suffix", ["png", "jpg", "ppm"])
def test_of_a_truncated_image_the_header_is_enough(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    pixels = np.random.default_rng(0).integers(0, 256, (200, 300, 3), np.uint8)
    path.write_bytes(cv2.imencode(f".{suffix}", pixels)[1].tobytes()[:1000])
    assert image_size(path) == (300, 200)
    with pytest.raises(BadInputError):
        read_grey(path)


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp"])
@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_a_tag_turns_the_image(tmp_path, suffix, orientation):
    path = write_turned(tmp_path / f"a.{suffix}", orientation)
    assert image_size(path) == ((30, 40) if orientation > 4 else (40, 30)) == read_grey(path).shape[::-1]


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_turned_tiff_is_as_read_grey_gives_it(tmp_path, orientation):
    path = write_turned(tmp_path / "a.tif", orientation)
    assert image_size(path) == read_grey(path).shape[::-1]


def write_turned(path, orientation):
    tags = Image.Exif()
    tags[ExifTags.Base.Orientation] = orientation
    Image.fromarray(np.full((30, 40), 90, np.uint8)).save(path, exif=tags)
    return path


def test_no_pixel_is_decoded(tmp_path, monkeypatch):
    monkeypatch.setattr("sips_lit.frames.image_size.read_grey", None)
    for suffix in ("jpg", "png", "ppm", "bmp", "tif", "webp"):
        path = tmp_path / f"a.{suffix}"
        cv2.imwrite(str(path), np.zeros((20, 30, 3), np.uint8))
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


def test_the_first_that_can_be_read(tmp_path):
    (tmp_path / "1.png").write_bytes(b"damaged")
    Image.new("L", (7, 5)).save(tmp_path / "2.png")
    assert first_size([tmp_path / "1.png", tmp_path / "2.png"]) == (7, 5)
    assert first_size([]) is None
    with pytest.raises(BadInputError, match=r"1\.png"):
        first_size([tmp_path / "1.png"])

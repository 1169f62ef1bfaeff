"""What comes out is compared with PIL, or with the numbers that went in."""

import io
import resource
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import PIL.ImageOps
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from textured_scenes import texture

from sips_lit.errors import BadInputError
from sips_lit.frames.images import decode_values, read_grey, read_rgb, resize_max_side, to_grey
from sips_lit.frames.listing import list_images
from sips_lit.frames.span import FULL

GREY = texture(48, 64)
COLOUR = np.stack([GREY, np.roll(GREY, 5, 1), 255 - GREY], -1)  # in BGR order


def luma(bgr: np.ndarray) -> np.ndarray:
    """Grey by the weights of ITU-R BT.601; the decoder of PNG rounds it down."""
    return bgr[..., :3].astype(np.float64) @ [0.114, 0.587, 0.299]


def saved(tmp_path: Path, name: str, image: np.ndarray) -> Path:
    assert cv2.imwrite(str(tmp_path / name), image)
    return tmp_path / name


def difference(image: np.ndarray, expected: np.ndarray) -> float:
    assert image.dtype == np.uint8
    assert image.shape == expected.shape
    return float(np.abs(image.astype(np.float64) - expected).max())


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif", ".tiff", ".pgm"])
def test_grey_is_read_as_it_is(tmp_path: Path, suffix: str):
    assert difference(read_grey(saved(tmp_path, "a" + suffix, GREY)), GREY) == 0


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif", ".ppm", ".PNG"])
def test_colour_becomes_grey(tmp_path: Path, suffix: str):
    assert difference(read_grey(saved(tmp_path, "a" + suffix, COLOUR)), luma(COLOUR)) < 1.01


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_alpha_is_dropped(tmp_path: Path, suffix: str):
    with_alpha = np.dstack([COLOUR, np.roll(GREY, 9, 0) // 2])
    assert difference(read_grey(saved(tmp_path, "a" + suffix, with_alpha)), luma(COLOUR)) < 1.01


@pytest.mark.parametrize("suffix", [".png", ".tif", ".pgm"])
def test_sixteen_bits_are_scaled_by_their_full_range(tmp_path: Path, suffix: str):
    values = np.linspace(0, 65535, 48 * 64).round().astype(np.uint16).reshape(48, 64)
    expected = np.floor(values.astype(np.float64) / 65535 * 255 + 0.5)
    assert difference(read_grey(saved(tmp_path, "a" + suffix, values)), expected) == 0


@pytest.mark.parametrize("suffix", [".png", ".tif", ".ppm"])
def test_sixteen_bit_colour(tmp_path: Path, suffix: str):
    assert difference(read_grey(saved(tmp_path, "a" + suffix, COLOUR.astype(np.uint16) * 257)), luma(COLOUR)) < 1.01


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_floating_point_from_0_to_1(tmp_path: Path, kind: type):
    assert difference(read_grey(saved(tmp_path, "a.tiff", (GREY / 255).astype(kind))), GREY) == 0


@pytest.mark.parametrize(
    "image",
    [GREY.astype(np.float32), np.full((8, 8), np.nan, np.float32), GREY.astype(np.int16), GREY - np.float32(300)],
)
def test_values_of_another_kind_are_refused(tmp_path: Path, image: np.ndarray):
    with pytest.raises(BadInputError, match=r"a\.tiff has values of type .*convert it"):
        read_grey(saved(tmp_path, "a.tiff", image))


@pytest.mark.parametrize(
    ("mode", "suffix"), [("P", ".png"), ("P", ".bmp"), ("1", ".png"), ("1", ".bmp"), ("1", ".tif"), ("LA", ".png")]
)
def test_as_pil_reads_it(tmp_path: Path, mode: str, suffix: str):
    pil = pytest.importorskip("PIL.Image")
    image = pil.fromarray(COLOUR[..., ::-1].copy())
    image = image.quantize(32) if mode == "P" else image.convert(mode)
    image.save(tmp_path / ("a" + suffix))
    assert difference(read_grey(tmp_path / ("a" + suffix)), np.asarray(image.convert("L"))) <= 1


def test_lab_is_refused(tmp_path: Path):
    lab = PIL.Image.merge("LAB", [PIL.Image.fromarray(GREY)] * 3)
    lab.save(tmp_path / "a.tif")
    with pytest.raises(BadInputError, match=r"a\.tif has colours in LAB.*save it as RGB"):
        read_grey(tmp_path / "a.tif")


@pytest.mark.parametrize("maximum", [1023, 4095])
def test_ten_and_twelve_bits(tmp_path: Path, maximum: int):
    """Whatever greatest value the header tells, and in big-endian order."""
    values = (GREY.astype(np.uint16) * (maximum // 255)).astype(">u2")
    (tmp_path / "a.pgm").write_bytes(b"P5 64 48 %d\n" % maximum + values.tobytes())
    np.testing.assert_array_equal(decode_values((tmp_path / "a.pgm").read_bytes(), "a"), values)
    assert difference(read_grey(tmp_path / "a.pgm"), to_grey(values, "a")) == 0


@pytest.mark.parametrize("progressive", [0, 1])
def test_jpeg(tmp_path: Path, progressive: int):
    pil = pytest.importorskip("PIL.Image")
    smooth = cv2.GaussianBlur(COLOUR, (0, 0), 2)
    cv2.imwrite(str(tmp_path / "a.jpg"), smooth, [cv2.IMWRITE_JPEG_PROGRESSIVE, progressive])
    image = read_grey(tmp_path / "a.jpg")
    assert (
        difference(image, np.asarray(pil.open(tmp_path / "a.jpg").convert("L"))) <= 6
    )  # libraries scale chroma differently
    assert np.abs(image - luma(smooth)).mean() < 2


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tif"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_stills_stand_upright(tmp_path: Path, suffix: str, orientation: int):
    """As OpenCV and Pillow show them."""
    path, tag = tmp_path / f"a.{suffix}", PIL.Image.Exif()
    tag[274] = orientation
    PIL.Image.fromarray(GREY).save(path, exif=tag, **({} if suffix == "tif" else {"quality": 100}))
    image = read_grey(path)
    np.testing.assert_array_equal(image, cv2.cvtColor(cv2.imdecode(np.fromfile(path, np.uint8), 1), cv2.COLOR_BGR2GRAY))
    upright = PIL.ImageOps.exif_transpose(PIL.Image.open(path)).convert("L")
    if suffix != "tif":  # Pillow turns a TIFF by itself, and again
        assert difference(image, np.asarray(upright)) <= 12


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif", ".pgm", ".webp"])
@pytest.mark.parametrize("image", [GREY, COLOUR], ids=["grey", "colour"])
def test_never_half_a_picture(tmp_path: Path, suffix: str, image: np.ndarray):
    if image.ndim == 3 and suffix == ".pgm":
        suffix = ".ppm"
    whole = saved(tmp_path, "whole" + suffix, image).read_bytes()
    part = tmp_path / ("part" + suffix)
    for cut in {1, 2, 10, *range(0, len(whole), len(whole) // 40), *range(len(whole) - 3, len(whole))}:
        part.write_bytes(whole[:cut])
        try:
            got = read_grey(part)
        except BadInputError as error:
            assert "part" in str(error)  # noqa: PT017 - refusing and reading it whole are both right
        else:
            assert cut > 0.95 * len(whole)  # nothing but a trailer is missing
            assert difference(got, read_grey(tmp_path / ("whole" + suffix))) == 0


def test_truncated_after_a_thumbnail(tmp_path: Path):
    # a camera's JPEG has a whole JPEG in its header: the end of that one is not the end of the picture
    pil = pytest.importorskip("PIL.Image")
    thumbnail, picture = io.BytesIO(), io.BytesIO()
    pil.fromarray(GREY[:16, :16]).save(thumbnail, "JPEG")
    pil.fromarray(GREY).save(picture, "JPEG")
    header = b"\xff\xe1" + (len(thumbnail.getvalue()) + 2).to_bytes(2, "big") + thumbnail.getvalue()
    whole = picture.getvalue()[:2] + header + picture.getvalue()[2:]
    path = tmp_path / "a.jpg"
    path.write_bytes(whole)
    assert difference(read_grey(path), np.asarray(pil.open(picture))) <= 1
    path.write_bytes(whole[: len(header) + 2 + (len(whole) - len(header)) * 3 // 4])
    with pytest.raises(BadInputError, match=r"a\.jpg"):
        read_grey(path)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_bytes_after_the_end_do_no_harm(tmp_path: Path, suffix: str):
    path = saved(tmp_path, "a" + suffix, GREY)
    expected = read_grey(path)
    path.write_bytes(path.read_bytes() + b"a film of the moment" * 1000)  # as some telephones do
    assert difference(read_grey(path), expected) == 0


def test_a_wrong_suffix_does_no_harm(tmp_path: Path):
    assert difference(read_grey(saved(tmp_path, "a.png", GREY).rename(tmp_path / "a.jpg")), GREY) == 0


@pytest.mark.parametrize("content", [b"", b"this is no image\n" * 100, b"\x89PNG\r\n\x1a\n"])
def test_not_an_image(tmp_path: Path, content: bytes):
    path = tmp_path / "notes.png"
    path.write_bytes(content)
    with pytest.raises(BadInputError, match=r"notes\.png is not an image"):
        read_grey(path)


def test_missing_and_directory(tmp_path: Path):
    with pytest.raises(BadInputError, match=r"gone\.png: No such file"):
        read_grey(tmp_path / "gone.png")
    with pytest.raises(BadInputError, match="cannot read the image"):
        read_grey(tmp_path)


def test_too_many_pixels_is_one_sentence(tmp_path: Path):
    path = tmp_path / "huge.pgm"
    path.write_bytes(b"P5 2000000 2000000 255\n" + bytes(100))
    with pytest.raises(BadInputError, match=r"huge\.pgm"):
        read_grey(path)


def test_path_with_letters_of_the_world(tmp_path: Path):
    path = tmp_path / "Straße 東京 é.png"
    saved(tmp_path, "a.png", GREY).rename(path)
    assert difference(read_grey(str(path)), GREY) == 0


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 90), st.integers(1, 90), st.integers(16, 100))
def test_resize_only_shrinks(height: int, width: int, max_side: int):
    resized = resize_max_side(np.zeros((height, width), np.uint8), max_side)
    if max(height, width) <= max_side:
        assert resized.shape == (height, width)
    else:
        assert max(resized.shape) == max_side
        scale = max_side / max(height, width)
        assert abs(resized.shape[0] - height * scale) <= 1
        assert abs(resized.shape[1] - width * scale) <= 1


def test_resize_averages():
    blocks = resize_max_side(GREY, 16)  # 4 x 4 pixels make one
    assert difference(blocks, GREY.reshape(12, 4, 16, 4).mean((1, 3))) <= 0.5
    assert resize_max_side(GREY, None) is GREY


@pytest.mark.shared_data
def test_real_images_as_opencv_reads_them(shared_data: Path):
    for path in [
        *list_images(shared_data / "rgbd_desk" / "color")[::30],
        *list_images(shared_data / "visp_cube")[::30],
    ]:
        colour = cv2.imread(str(path), cv2.IMREAD_COLOR)
        assert difference(read_grey(path), cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)) == 0


NOISE = np.random.default_rng(0).integers(0, 256, (40, 50, 3), np.uint8)


@pytest.mark.parametrize(
    ("suffix", "bits"),
    [("png", 8), ("bmp", 8), ("tiff", 8), ("ppm", 8), ("webp", 8), ("jpg", 8), ("png", 16), ("tiff", 16), ("ppm", 16)],
)
def test_one_grey_by_name_and_as_an_array(tmp_path: Path, suffix: str, bits: int):
    """A lossless file, what OpenCV and Pillow read from it, and the array itself are one image."""
    values = NOISE if bits == 8 else NOISE.astype(np.uint16) * 257
    path = tmp_path / f"a.{suffix}"
    options = [cv2.IMWRITE_WEBP_QUALITY, 101] if suffix == "webp" else []
    assert cv2.imwrite(str(path), values, options)
    stored = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if suffix != "jpg":
        np.testing.assert_array_equal(stored, values)
    wanted = cv2.cvtColor(stored, cv2.COLOR_BGR2GRAY)
    wanted = wanted if bits == 8 else (wanted / 257 + 0.5).astype(np.uint8)
    np.testing.assert_array_equal(read_grey(path), wanted)
    np.testing.assert_array_equal(to_grey(stored, "a"), wanted)
    np.testing.assert_array_equal(to_grey(stored[..., ::-1], "a", rgb=True), wanted)
    if bits == 8:
        pillow = np.asarray(PIL.Image.open(path).convert("RGB"))
        assert np.abs(to_grey(pillow, "a", rgb=True).astype(int) - wanted).max() <= (3 if suffix == "jpg" else 0)


@pytest.mark.parametrize("order", ["<u2", ">u2"])
def test_byte_order_does_not_matter(order: str):
    values = np.linspace(0, 65535, 2000).reshape(40, 50).astype(np.uint16)
    np.testing.assert_array_equal(to_grey(values.astype(order), "a"), to_grey(values, "a"))


def test_a_thermal_image_alone_uses_its_own_range(tmp_path: Path):
    grey = texture(120, 160)
    path = tmp_path / "thermal.png"
    assert cv2.imwrite(str(path), (28900 + grey.astype(np.uint16) * 4))
    read = read_grey(path)
    assert read.std() > 0.7 * grey.std()
    assert np.corrcoef(read.ravel(), grey.ravel())[0, 1] > 0.999
    np.testing.assert_array_equal(read_grey(path, FULL), (28900 + grey.astype(float) * 4 + 128) // 257)


def test_headers_that_claim_more_pixels_than_the_file_holds():
    """libjpeg would fill 32000 x 32000 pixels of grey, for a minute."""
    data = cv2.imencode(".jpg", texture(48, 64))[1].tobytes()
    start = data.index(b"\xff\xc0") + 5
    large = data[:start] + (32000).to_bytes(2, "big") * 2 + data[start + 4 :]
    with pytest.raises(BadInputError, match=r"a\.jpg claims more pixels than its \d+ bytes can hold"):
        decode_values(large, "a.jpg")
    larger = data[:start] + (7000).to_bytes(2, "big") * 2 + data[start + 4 :]
    with pytest.raises(BadInputError, match="claims more pixels"):
        decode_values(larger, "a.jpg")


def test_images_that_hardly_need_bytes_are_read():
    black = np.zeros((5000, 6600), np.uint8)
    for suffix in (".png", ".jpg", ".tif"):
        np.testing.assert_array_equal(decode_values(cv2.imencode(suffix, black)[1].tobytes(), "black"), black)


def test_a_length_in_a_png_that_asks_for_gigabytes():
    """OpenCV would allocate them, and fill them for seconds, before it finds that the file ends."""
    data = cv2.imencode(".png", GREY)[1].tobytes()
    np.testing.assert_array_equal(decode_values(data + b"some more", "a.png"), GREY)
    at = data.index(b"IDAT") - 4
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(BadInputError, match=r"a\.png is not an image that OpenCV can read, or is truncated"):
        decode_values(data[:at] + b"\xee" + data[at + 1 :], "a.png")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before + 100_000  # kB


def test_rgb_of_files(tmp_path):
    path, colour = tmp_path / "a.png", np.dstack([np.full((4, 5), value, np.uint8) for value in (10, 20, 200)])
    cv2.imwrite(str(path), colour[:, :, ::-1])
    np.testing.assert_array_equal(read_rgb(path), colour)
    cv2.imwrite(str(path), colour[:, :, 0])
    np.testing.assert_array_equal(read_rgb(path), np.dstack([colour[:, :, 0]] * 3))
    cv2.imwrite(str(path), np.arange(20, dtype=np.uint16).reshape(4, 5) * 3000)
    np.testing.assert_array_equal(read_rgb(path), np.dstack([read_grey(path)] * 3))
    np.testing.assert_array_equal(read_rgb(path, colour[:, :, 1]), np.dstack([colour[:, :, 1]] * 3))

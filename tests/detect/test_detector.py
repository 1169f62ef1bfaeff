import warnings
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from textured_scenes import texture
from tiny_network import save_lightning, tiny_detector, tiny_network

from sips_lit.detect.budget import Budget
from sips_lit.detect.detector import SipsDetector, as_grey
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.types import Keypoints

GREY = texture(77, 101)
RGB = np.dstack([texture(77, 101, seed) for seed in (1, 2, 3)])
# the weights of ITU-R BT.601
LUMA = np.rint(RGB @ np.array([0.299, 0.587, 0.114]))
BGR = np.ascontiguousarray(RGB[:, :, ::-1])  # as cv2.imread gives it


def same(a: Keypoints, b: Keypoints) -> None:
    np.testing.assert_array_equal(a.xy, b.xy)
    np.testing.assert_array_equal(a.score, b.score)
    np.testing.assert_array_equal(a.scale, b.scale)


@pytest.fixture(scope="module")
def detector() -> SipsDetector:
    return tiny_detector()


def type_of(given) -> str:
    """Names a test by the type of image that it takes."""
    mode = getattr(given, "mode", "")
    return f"{type(given).__name__}-{mode if isinstance(mode, str) else ''}{getattr(given, 'dtype', '')}"


@pytest.mark.parametrize(
    "given",
    [
        GREY[:, :, None],
        GREY / np.float32(255),
        GREY / 255.0,
        GREY.astype(np.uint16) * 257,
        GREY[:, ::-1][:, ::-1],
        np.asfortranarray(GREY),
        np.dstack([GREY] * 3),
        np.dstack([GREY, GREY, GREY, GREY // 9]),
        PIL.Image.fromarray(GREY),
        PIL.Image.fromarray(GREY).convert("P"),
        PIL.Image.fromarray(GREY).convert("LA"),
        PIL.Image.fromarray(np.dstack([GREY] * 3)),
        PIL.Image.fromarray(GREY.astype(np.uint16) * 257),
        torch.from_numpy(GREY),
        torch.from_numpy(GREY)[None],
        torch.from_numpy(GREY).expand(3, -1, -1),
        torch.from_numpy(GREY)[None] / 255,
        (torch.from_numpy(GREY) / 255).requires_grad_(),
        GREY.astype(np.float32),
        GREY.astype(np.float16),
        GREY.astype(np.float64)[:, :, None],
        torch.from_numpy(GREY)[None].float(),
        np.repeat(np.repeat(GREY, 2, 0), 3, 1)[::2, ::3],
        torch.from_numpy(GREY.T.copy()).T,
    ],
    ids=type_of,
)
def test_every_type_of_image_gives_the_same_points(detector, given):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(as_grey(given), GREY)
        same(detector(given, 20), detector.detect(GREY, 20))


@pytest.mark.parametrize(
    "given",
    [
        RGB,
        RGB / 255.0,
        RGB.astype(np.uint16) * 257,
        PIL.Image.fromarray(RGB),
        PIL.Image.fromarray(RGB).convert("RGBA"),
        PIL.Image.fromarray(RGB).convert("CMYK"),
        torch.from_numpy(RGB).permute(2, 0, 1),
    ],
    ids=type_of,
)
def test_colours_are_red_green_blue(given):
    grey = as_grey(given)
    assert grey.dtype == np.uint8
    assert np.abs(grey - LUMA).max() <= 1


@pytest.mark.parametrize(
    "given", [BGR, np.dstack([BGR, GREY]), BGR / 255.0, torch.from_numpy(BGR).permute(2, 0, 1)], ids=type_of
)
def test_arrays_of_opencv_are_blue_green_red_if_one_says_so(given):
    np.testing.assert_array_equal(as_grey(given, color="bgr"), cv2.cvtColor(BGR, cv2.COLOR_BGR2GRAY))
    assert np.abs(as_grey(given) - LUMA).max() > 20, "the grey values of both orders must differ"


@pytest.mark.parametrize("given", ["file", PIL.Image.fromarray(RGB)], ids=type_of)
def test_files_and_pil_images_know_their_order(given, tmp_path):
    if isinstance(given, str):
        given = tmp_path / "image.png"
        cv2.imwrite(str(given), BGR)
    assert np.abs(as_grey(given, color="bgr") - LUMA).max() <= 1


def test_every_call_of_the_detector_takes_the_order(detector):
    expected = detector.detect(cv2.cvtColor(BGR, cv2.COLOR_BGR2GRAY), 20)
    same(detector(BGR, 20, color="bgr"), expected)
    same(detector([BGR, BGR], 20, color="bgr")[1], expected)
    same(detector.within(BGR, Budget(20), color="bgr")[0], expected)
    assert not np.array_equal(detector(BGR, 20).xy, expected.xy)
    with pytest.raises(BadInputError, match=r"color is gbr: give rgb or bgr"):
        detector(BGR, color="gbr")


@pytest.mark.parametrize("mode", ["YCbCr", "HSV"])
def test_other_colour_spaces_are_converted(mode):
    assert np.abs(as_grey(PIL.Image.fromarray(RGB).convert(mode)) - LUMA).max() <= 4


def test_indices_of_a_palette_are_looked_up():
    indices = PIL.Image.fromarray(GREY)
    indices.putpalette(np.repeat(np.arange(255, -1, -1), 3).astype(np.uint8).tobytes())  # index i is grey 255 - i
    assert indices.mode == "P"
    np.testing.assert_array_equal(as_grey(indices), 255 - GREY)


def test_16_bits_are_rounded_to_the_nearest_of_8():
    every = np.arange(2**16, dtype=np.uint16).reshape(256, 256)
    np.testing.assert_array_equal(as_grey(every), np.rint(every / 65535 * 255))


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_tensors_of_half_precision(dtype):
    grey = as_grey((torch.from_numpy(GREY) / 255).to(dtype))
    assert np.abs(grey.astype(int) - GREY).max() <= (1 if dtype == torch.bfloat16 else 0)


def test_a_truth_map_is_black_and_white():
    np.testing.assert_array_equal(as_grey(GREY > 127), np.where(GREY > 127, 255, 0))
    np.testing.assert_array_equal(as_grey(PIL.Image.fromarray(GREY > 127)), np.where(GREY > 127, 255, 0))


@pytest.mark.parametrize("kind", [str, Path])
def test_a_path(detector, tmp_path, kind):
    path = tmp_path / "image.png"
    cv2.imwrite(str(path), GREY)
    same(detector(kind(path), 20), detector.detect(GREY, 20))
    cv2.imwrite(str(path), GREY.astype(np.uint16) * 257)
    same(detector(kind(path), 20), detector.detect(GREY, 20))
    cv2.imwrite(str(path), RGB[:, :, ::-1])
    assert np.abs(as_grey(kind(path)) - LUMA).max() <= 1


def test_the_image_is_not_touched(detector):
    image = GREY.copy()
    detector(image, 20)
    np.testing.assert_array_equal(image, GREY)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (np.zeros((2, 3, 3, 3)), "not of shape"),
        (np.zeros((4, 4, 2), np.uint8), "not of shape"),
        (torch.zeros(2, 8, 8), "not of shape"),
        (np.zeros(7, np.uint8), "not of shape"),
        (None, "not of shape"),
        (np.zeros((0, 5), np.uint8), "empty"),
        (np.zeros((5, 0, 3), np.uint8), "empty"),
        (GREY.astype(np.int64), "not int64"),
        (GREY.astype(complex), "not complex128"),
        (GREY.astype(np.float32) + 9, "divide it by 255"),
        (GREY / np.float32(50), "divide it by 255"),  # from 0 to 5: neither range
        (GREY - np.float32(1e-3), "from -0.001"),
        (np.where(GREY > 250, np.inf, GREY), "finite"),
        (torch.full((1, 4, 4), torch.nan), "finite"),
        (np.where(GREY > 250, np.nan, GREY), "finite"),
        (np.full((4, 4), np.nan), "finite"),
        (np.full((4, 4), -0.1), "finite values from 0 to 1"),
        ("no/such/image.png", "cannot read the image no/such/image.png"),
    ],
)
def test_what_is_no_image_is_refused(detector, given, reason):
    with pytest.raises(BadInputError, match=reason):
        detector(given)


@settings(max_examples=25, deadline=None)
@given(height=st.integers(1, 40), width=st.integers(1, 40), n=st.integers(0, 60))
def test_images_of_any_size(detector, height, width, n):
    image = texture(40, 40)[:height, :width]
    points, every = detector(image, n), detector(image, 10**9)
    assert len(points) == min(n, len(every))
    assert points.xy.shape == (len(points), 2)
    assert 1 <= len(every) <= height * width
    same(points, every.best(n))
    assert np.all(np.diff(every.score) <= 0)
    assert np.all((every.score > 0) & (every.score < 1))
    assert np.all((every.xy >= -0.5) & (every.xy <= [width - 0.5, height - 0.5]))
    distance = np.abs(every.xy[:, None] - every.xy).max(2) + 99 * np.eye(len(every))
    assert distance.min() > 5 - 1  # half a pixel each is the fit's


def test_one_pixel_is_one_point(detector):
    points = detector(np.full((1, 1), 128, np.uint8))
    np.testing.assert_array_equal(points.xy, [[0, 0]])
    np.testing.assert_array_equal(points.scale, [1])


def test_fifty_points_by_default(detector):
    assert len(detector(texture(150, 200))) == 50 < len(detector(texture(150, 200), 10**6))


def test_no_points_and_fewer_than_none(detector):
    none = detector(GREY, 0)
    assert none.xy.shape == (0, 2)
    assert none.score.shape == none.scale.shape == (0,)
    with pytest.raises(BadInputError, match="n is -1"):
        detector(GREY, -1)


def test_the_score_at_a_point_is_that_of_the_map():
    detector = tiny_detector(subpixel=False)
    points, scores = detector(GREY, 30), detector.score_map(GREY)
    assert scores.shape == GREY.shape
    assert scores.dtype == np.float32
    column, row = points.xy.astype(int).T
    np.testing.assert_allclose(points.score, scores[row, column], rtol=1e-6)
    assert points.score[0] == pytest.approx(scores.max(), rel=1e-6)


def test_weights_that_are_not_finite():
    network = tiny_network()
    with torch.no_grad():
        network.layers[1].weight[0, 0, 0, 0] = torch.nan
    with pytest.raises(BadInputError, match="not finite: its weights are broken"):
        SipsDetector(network, PointSelector())(GREY)


def test_several_scales():
    detector = SipsDetector(tiny_network(scales=3), PointSelector())
    points = detector(GREY, 10**6)
    assert set(np.round(points.scale**2)) == {1, 2, 4}
    same(points.best(15), detector(GREY, 15))
    assert len(detector(GREY[:1, :1])) == 1


def test_the_points_have_no_descriptors(detector):
    assert detector.describes is False
    with pytest.raises(TypeError, match="describe them"):
        detector.detect_and_describe(GREY, 5)


def test_from_a_checkpoint(tmp_path):
    path = save_lightning(tmp_path / "best.ckpt", tiny_network(), PointSelector(3, subpixel=False))
    same(SipsDetector.from_checkpoint(path)(GREY), tiny_detector(nms_radius=3, subpixel=True)(GREY))
    coarse = SipsDetector.from_checkpoint(str(path), subpixel=False)(GREY)
    same(coarse, tiny_detector(nms_radius=3, subpixel=False)(GREY))
    np.testing.assert_array_equal(coarse.xy, np.rint(coarse.xy))


def test_other_suppression_and_more_scales_than_the_checkpoint_has(tmp_path):
    path = save_lightning(tmp_path / "best.ckpt", tiny_network(), PointSelector(3))
    same(SipsDetector.from_checkpoint(path, nms_radius=1)(GREY), tiny_detector(nms_radius=1)(GREY))
    several = SipsDetector.from_checkpoint(path, scales=3)(GREY)
    assert set(np.round(several.scale**2)) == {1, 2, 4}
    same(several, SipsDetector(tiny_network().detecting_by(scales=3), PointSelector(3))(GREY))
    same(
        SipsDetector.from_checkpoint(path, border=3)(GREY),
        SipsDetector(tiny_network(), PointSelector(3, border=3))(GREY),
    )
    two = SipsDetector.from_checkpoint(path, octaves=2)
    same(two(GREY), SipsDetector(tiny_network(octaves=2), PointSelector(3))(GREY))
    assert not np.array_equal(two(GREY).xy, SipsDetector.from_checkpoint(path)(GREY).xy)
    cornered = SipsDetector.from_checkpoint(path, corners=2)
    same(cornered(GREY), SipsDetector(tiny_network(corners=2.0), PointSelector(3))(GREY))
    assert not np.array_equal(cornered(GREY).xy, SipsDetector.from_checkpoint(path)(GREY).xy)
    halved = SipsDetector.from_checkpoint(path, first_octave=1, fine_corners=0.5)
    same(halved(GREY), SipsDetector(tiny_network(first_octave=1, fine_corners=0.5), PointSelector(3))(GREY))
    assert not np.array_equal(halved(GREY).xy, SipsDetector.from_checkpoint(path, first_octave=1)(GREY).xy)
    between = SipsDetector.from_checkpoint(path, octaves=2, first_octave=0.5, octave_step=0.5)
    same(
        between(GREY), SipsDetector(tiny_network(octaves=2, first_octave=0.5, octave_step=0.5), PointSelector(3))(GREY)
    )
    small = SipsDetector.from_checkpoint(path, first_octave=1, fine_corners=0.5, whole_below=GREY.size + 1)
    same(small(GREY), SipsDetector.from_checkpoint(path, octaves=2)(GREY))
    with pytest.raises(BadInputError, match="nms_radius is -1"):
        SipsDetector.from_checkpoint(path, nms_radius=-1)
    with pytest.raises(BadInputError, match="border is -1"):
        SipsDetector.from_checkpoint(path, border=-1)
    with pytest.raises(BadInputError, match="1 to 8 octaves, not 0"):
        SipsDetector.from_checkpoint(path, octaves=0)
    with pytest.raises(BadInputError, match="corners weigh 0 to 10, not -1"):
        SipsDetector.from_checkpoint(path, corners=-1)
    with pytest.raises(BadInputError, match="first octave is 0"):
        SipsDetector.from_checkpoint(path, first_octave=-1)
    with pytest.raises(BadInputError, match="1 to 32 scales"):
        SipsDetector.from_checkpoint(path, scales=0)


def test_a_big_endian_pil_image_and_one_in_lab():
    deep = PIL.Image.frombytes("I;16B", GREY.shape[::-1], (GREY.astype(">u2") * 257).tobytes())
    np.testing.assert_array_equal(as_grey(deep), GREY)
    with pytest.raises(BadInputError, match="LAB must be converted first"):
        as_grey(PIL.Image.frombytes("LAB", (50, 40), bytes(6000)))


MIXED = [GREY, RGB, GREY[:5, :7], torch.from_numpy(GREY)[None] / 255, PIL.Image.fromarray(RGB)]


@pytest.mark.parametrize("kind", [list, tuple])
def test_a_batch_of_mixed_sizes_is_its_images(detector, kind):
    found = detector(kind(MIXED), 20)
    assert len(found) == 5
    for points, image in zip(found, MIXED, strict=True):
        same(points, detector(image, 20))


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("scale", [1, 255])
def test_a_batch_in_a_tensor_is_its_images(detector, channels, scale):
    images = [texture(40, 60, seed) for seed in range(3)]
    stacked = torch.stack([torch.from_numpy(image).expand(channels, -1, -1) for image in images])
    for batch in (stacked, stacked / 255 * scale, stacked.flip(3).flip(3), stacked.transpose(2, 3).transpose(2, 3)):
        found = detector(batch, 20)
        for points, image in zip(found, images, strict=True):
            same(points, detector(image, 20))


def test_a_batch_of_nothing(detector):
    assert detector([]) == detector(torch.zeros(0, 1, 8, 8)) == []


def test_the_image_of_a_batch_that_is_none_is_named(detector):
    with pytest.raises(BadInputError, match="image 1 of the batch has values of type float64 from nan"):
        detector([GREY, np.full((4, 4), np.nan)])
    with pytest.raises(BadInputError, match=r"image 0 of the batch must be \(H, W\)"):
        detector(torch.zeros(1, 2, 8, 8))
    with pytest.raises(BadInputError, match="image 1 of the batch must be"):
        detector([GREY, [GREY]])


@pytest.mark.parametrize("scales", [1, 3])
@pytest.mark.parametrize("grey", [0, 99, 255])
@pytest.mark.parametrize("size", [(77, 101), (1, 50), (3, 2)])
def test_a_blank_image_has_few_points(scales, grey, size):
    detector = SipsDetector(tiny_network(scales=scales), PointSelector())
    assert len(detector(np.full(size, grey, np.uint8), 10**6)) <= 5  # rounding errors of convolutions


@pytest.mark.parametrize("derivatives", [False, True])
@pytest.mark.parametrize("size", [(1, 1), (1, 40), (4, 4), (20, 3)])
def test_images_smaller_than_the_receptive_field(derivatives, size):
    torch.manual_seed(0)
    detector = SipsDetector(ScoreNetwork(10, 4, derivatives=derivatives), PointSelector())
    points = detector(texture(40, 40)[: size[0], : size[1]], 5)
    assert 1 <= len(points) <= 5
    assert np.isfinite(points.xy).all()
    assert np.all((points.score > 0) & (points.score < 1))


def test_the_device_is_where_the_network_is(detector):
    assert detector.device == torch.device("cpu")

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.datasets.calibration import (
    PhotometricCorrection,
    read_fov_camera,
    read_inverse_response,
    read_rectified_camera,
    read_vignette,
)
from sips_lit.errors import BadInputError

LINES = ["0.5 0.625 0.5 0.25 0.9", "640 512", "crop", "320 240"]
# about the wide lens of the data set, whose corners are more than 90 degrees off the axis
WIDE = ["0.349153 0.436593 0.493140 0.499021 0.933592", "1280 1024", "crop", "640 480"]


def write(path: Path, lines: list[str], **changes: str) -> Path:
    lines = [changes.get(f"line{number}", line) for number, line in enumerate(lines, 1)]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_numbers_are_relative_to_the_outer_edges(tmp_path: Path):
    camera = read_fov_camera(write(tmp_path / "camera.txt", LINES))
    # the middle between 640 pixels is that of pixels 319 and 320; a quarter of 512 rows lies between rows 127 and 128
    np.testing.assert_allclose(camera.matrix, [[320, 0, 319.5], [0, 320, 127.5], [0, 0, 1]])
    assert (camera.omega, camera.size) == (0.9, (640, 512))


def test_crop_of_the_published_wide_lens(tmp_path: Path):
    file = write(tmp_path / "camera.txt", WIDE)
    camera = read_fov_camera(file)
    crop = read_rectified_camera(file, camera)
    assert crop.size == (640, 480)
    # the horizontal field of view from the model's words: distances to both edges times omega are angles
    half = math.tan(0.933592 / 2) * 2
    left = math.tan((0.493140 - 0.5 / 1280) / 0.349153 * 0.933592) / half
    right = math.tan((1 - 0.493140 - 0.5 / 1280) / 0.349153 * 0.933592) / half
    np.testing.assert_allclose(crop.matrix[0, 0], 639 / (left + right), rtol=1e-9)
    np.testing.assert_allclose(crop.matrix[0, 2], 639 * left / (left + right), rtol=1e-9)
    with pytest.raises(
        BadInputError, match=r"line 3 of .*camera\.txt asks for full, but the corners .*, or crop, or set"
    ):
        read_rectified_camera(write(file, WIDE, line3="full"), camera)


def test_numbers_of_a_rectified_camera(tmp_path: Path):
    file = write(tmp_path / "camera.txt", LINES, line3="0.4 0.6 0.5 0.5 0")
    rectified = read_rectified_camera(file, read_fov_camera(file))
    np.testing.assert_allclose(rectified.matrix, [[128, 0, 159.5], [0, 144, 119.5], [0, 0, 1]])


@pytest.mark.parametrize(
    ("line", "text", "words"),
    [
        (1, "0.5 0.6 0.5 0.5", r"line 1 of .*camera\.txt is '0\.5 0\.6 0\.5 0\.5', not fx fy cx cy omega"),
        (1, "0.5 0.6 0.5 x 0.9", r"line 1 of .* has 'x' where a number"),
        (1, "0.5 0.6 0.5 nan 0.9", r"line 1 of .* has 'nan'"),
        (1, "458.6 457.2 367.2 248.3 0.9", r"line 1 of .* relative to the image's size"),
        (1, "-0.5 0.6 0.5 0.5 0.9", r"line 1 of .* focal lengths must be positive"),
        (1, "0.5 0.6 0.5 0.5 3.2", r"line 1 of .* omega = 3\.2"),
        (1, "0.5 0.6 0.5 0.5 -1", r"line 1 of .* omega = -1"),
        (2, "640", r"line 2 of .* is '640', not width height"),
        (2, "640.5 512", r"line 2 of .* is no size of an image: 640\.5 512"),
        (2, "0 512", r"line 2 of .* is no size"),
        (3, "corp", r"line 3 of .* is 'corp', not crop, full, none or fx fy cx cy 0"),
        (3, "none", r"line 3 of .* is none, no rectification: write crop there, or set data\.geometric=false"),
        (3, "0.4 0.6 0.5 0.5 0.1", r"line 3 of .* ends in 0\.1: .* write 0"),
        (3, "0.4 0.6 1.5 0.5 0", r"line 3 of .* centre between 0 and 1"),
        (
            1,
            "0.5 1e308 0.5 0.5 0.9",
            r"camera\.txt has focal lengths 320, inf and the centre .* can't be of images of 640x512",
        ),
        (1, "0.5 1e-9 0.5 0.5 0.9", r"camera\.txt has focal lengths .* can't be of images"),
        (2, "1e300 512", r"line 2 of .* is no size"),
        (4, "60000 60000", r"line 4 of .* asks for images of over 16 times the pixels"),
        (4, "crop", r"line 4 of .* is 'crop', not width height"),
    ],
)
def test_a_wrong_line_is_named(tmp_path: Path, line: int, text: str, words: str):
    file = write(tmp_path / "camera.txt", LINES, **{f"line{line}": text})
    with pytest.raises(BadInputError, match=words):
        read_rectified_camera(file, read_fov_camera(file))


def test_missing_lines(tmp_path: Path):
    with pytest.raises(BadInputError, match=r"camera\.txt has 3 lines, not 4"):
        read_fov_camera(write(tmp_path / "camera.txt", LINES[:3]))


def test_a_fisheye_cannot_be_cropped(tmp_path: Path):
    file = write(tmp_path / "camera.txt", LINES, line1="0.2 0.25 0.5 0.5 0.95")
    with pytest.raises(
        BadInputError, match=r"line 3 of .* asks for crop, but the image reaches 90 degrees .* there, or set"
    ):
        read_rectified_camera(file, read_fov_camera(file))


def write_response(path: Path, values: np.ndarray) -> Path:
    path.write_text(" ".join(map(str, values)) + " \n")
    return path


@given(seed=st.integers(0, 1000), gamma=st.floats(0.5, 3))
@settings(max_examples=20, deadline=None)
def test_correction_pixel_by_pixel(seed: int, gamma: float):
    generator = np.random.default_rng(seed)
    image = generator.integers(0, 256, (7, 9), np.uint8)
    response = 255 * (np.arange(256) / 255) ** gamma
    vignette = generator.uniform(0.2, 1, (7, 9))
    corrected = PhotometricCorrection(response, vignette)(image)
    assert corrected.dtype == np.uint8
    for row in range(7):
        for column in range(9):
            light = min(255.0, response[image[row, column]] / vignette[row, column])
            assert abs(corrected[row, column] - light) <= 0.5 + 1e-3


def test_correction_undoes_what_the_camera_did():
    light = np.tile(np.linspace(0, 200, 60), (40, 1))
    x, y = np.meshgrid(np.linspace(-1, 1, 60), np.linspace(-1, 1, 40))
    vignette = 1 / (1 + 0.5 * (x**2 + y**2))
    recorded = np.round(255 * (light * vignette / 255) ** (1 / 1.8)).astype(np.uint8)
    corrected = PhotometricCorrection(255 * (np.arange(256) / 255) ** 1.8, vignette)(recorded)
    assert (
        np.abs(corrected - light).max() < 2.5
    )  # one grey value of the record is up to 1.8 / vignette, half of it lost
    assert np.abs(recorded - light).max() > 30


def test_a_perfect_camera_changes_nothing():
    image = np.arange(256, dtype=np.uint8).reshape(16, 16)
    np.testing.assert_array_equal(PhotometricCorrection(np.arange(256.0), np.ones((16, 16)))(image), image)


def test_inverse_response_is_scaled(tmp_path: Path):
    values = 3 + 7 * np.arange(256) ** 1.5
    read = read_inverse_response(write_response(tmp_path / "pcalib.txt", values))
    assert (read[0], read[255]) == (0, 255)
    np.testing.assert_allclose(np.diff(read) / np.diff(values), 255 / (values[-1] - values[0]))


def test_bad_inverse_responses(tmp_path: Path):
    path = tmp_path / "pcalib.txt"
    good = np.arange(256.0)
    cases = {
        "line 1 of .* has 255 values: the inverse response has 256": good[:255],
        "does not rise from value 9 to 10": np.where(np.arange(256) == 10, 9, good),
        "has 'nan'": np.where(np.arange(256) == 10, np.nan, good),
    }
    for words, values in cases.items():
        with pytest.raises(BadInputError, match=words):
            read_inverse_response(write_response(path, values))
    path.write_text("\n")
    with pytest.raises(BadInputError, match="is empty"):
        read_inverse_response(path)
    with pytest.raises(BadInputError, match="cannot read"):
        read_inverse_response(tmp_path / "gone.txt")


@pytest.mark.parametrize(("dtype", "largest"), [(np.uint8, 200), (np.uint16, 60000)])
def test_vignette_is_scaled(tmp_path: Path, dtype: type, largest: int):
    stored = np.linspace(largest // 3, largest, 8 * 6).reshape(6, 8).astype(dtype)
    cv2.imwrite(str(tmp_path / "v.png"), stored)
    np.testing.assert_allclose(read_vignette(tmp_path / "v.png", (8, 6)), stored / largest)


def test_what_the_calibration_did_not_see_is_as_its_nearest_neighbour(tmp_path: Path):
    stored = np.full((9, 12), 30000, np.uint16)
    stored[:, :4], stored[:, 4] = 0, 20000
    stored[4, 11] = 0
    cv2.imwrite(str(tmp_path / "v.png"), stored)
    expected = np.ones((9, 12))
    expected[:, :5] = 2 / 3
    np.testing.assert_allclose(read_vignette(tmp_path / "v.png", (12, 9)), expected)


def test_bad_vignettes(tmp_path: Path):
    path = tmp_path / "vignette.png"
    with pytest.raises(BadInputError, match=r"cannot read the image .*vignette"):
        read_vignette(path, (8, 6))
    for data in (b"", b"no image"):
        path.write_bytes(data)
        with pytest.raises(BadInputError, match="is not an image that OpenCV can read"):
            read_vignette(path, (8, 6))
    cv2.imwrite(str(path), np.ones((6, 8, 3), np.uint8))
    with pytest.raises(BadInputError, match="is not a grey image"):
        read_vignette(path, (8, 6))
    cv2.imwrite(str(path), np.ones((8, 6), np.uint16))
    with pytest.raises(BadInputError, match="is 6x8, but the images are 8x6"):
        read_vignette(path, (8, 6))
    cv2.imwrite(str(path), np.zeros((6, 8), np.uint16))
    with pytest.raises(BadInputError, match="is black"):
        read_vignette(path, (8, 6))

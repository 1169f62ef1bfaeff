import math
from pathlib import Path

import numpy as np
import pytest

from sips_lit.datasets.camera_file import read_fov_camera, read_rectified_camera
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

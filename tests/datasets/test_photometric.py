from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.datasets.photometric import PhotometricCorrection, read_inverse_response, read_vignette
from sips_lit.errors import BadInputError


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

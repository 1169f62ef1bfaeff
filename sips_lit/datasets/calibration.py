"""Calibration files of TUM mono (and DSO): the lens, a FOV camera, and the light, inverse response and vignette.

Engel, Usenko and Cremers, "A photometrically calibrated benchmark for monocular visual odometry" (2016): an image is
I = G(t V B), with the response G, the exposure time t, the vignette V of every pixel and the irradiance B.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.datasets.layout import expect_camera, expect_size, read_rows, to_numbers
from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_stored
from sips_lit.geometry.fov_camera import FovCamera, crop_camera, full_camera
from sips_lit.types import Camera, FloatArray, GreyImage

LARGEST_SIDE = 2**16  # pixels
LARGEST_ZOOM = 16  # times as many pixels in a rectified image


def read_fov_camera(file: Path) -> FovCamera:
    """The camera of the first two lines: ``fx fy cx cy omega``, and the size of its images in pixels.

    omega is in radians, the other numbers are relative to the image, whose outer edges are at 0 and 1. Raises BadInputError
    with the line that is something else.
    """
    first, second = _rows(file)[:2]
    *values, omega = _numbers(file, first, 5, "fx fy cx cy omega")
    if not 0 <= omega < np.pi:
        raise BadInputError(f"line {first[0]} of {file} has omega = {omega:g}: it must be from 0 to 3.14 radians")
    size = _size(file, second)
    return FovCamera(_matrix(file, first[0], values, size), omega, size)


def read_rectified_camera(file: Path, camera: FovCamera) -> Camera:
    """The pinhole camera of the last two lines: how images of ``camera`` are to be rectified, and the size that they get.

    How: ``crop``, ``full``, or ``fx fy cx cy 0``, relative to the image as above. Raises BadInputError with the line that is
    something else, is ``none``, or asks for what no pinhole camera shows.
    """
    (line, words), last = _rows(file)[2:4]
    size = _size(file, last)
    if size[0] * size[1] > LARGEST_ZOOM * camera.size[0] * camera.size[1]:
        raise BadInputError(
            f"line {last[0]} of {file} asks for images of over {LARGEST_ZOOM} times the pixels that there are"
        )
    if words == ["none"]:
        raise BadInputError(
            f"line {line} of {file} is none, no rectification: write crop there, or set data.geometric=false"
        )
    if words in (["crop"], ["full"]):
        try:
            return crop_camera(camera, size) if words == ["crop"] else full_camera(camera, size)
        except BadInputError as error:
            raise BadInputError(
                f"line {line} of {file} asks for {words[0]}, but {error}: write the five numbers of a rectified camera there"
                f"{', or crop' if words == ['full'] else ''}, or set data.geometric=false"
            ) from error
    *values, omega = _numbers(file, (line, words), 5, "crop, full, none or fx fy cx cy 0")
    if omega != 0:
        raise BadInputError(f"line {line} of {file} ends in {omega:g}: a rectified camera has no distortion, write 0")
    return Camera(_matrix(file, line, values, size), size)


class PhotometricCorrection:
    """Turns an image into t B, the irradiance times the exposure time, as uint8.

    ``inverse_response`` (256,) rises from 0 to 255; ``vignette`` (H, W), larger than 0 and up to 1, is what fraction of the
    light arrives at a pixel. What would exceed 255 becomes 255.
    """

    def __init__(self, inverse_response: FloatArray, vignette: FloatArray) -> None:
        self._inverse_response = np.asarray(inverse_response, np.float32)
        self._gain = np.asarray(1 / vignette, np.float32)

    def __call__(self, image: GreyImage) -> GreyImage:
        """The corrected image of the same size."""
        linear = cv2.LUT(image, self._inverse_response)
        return np.asarray(cv2.multiply(linear, self._gain, dtype=cv2.CV_8U), np.uint8)  # rounds and saturates


def read_inverse_response(path: Path) -> NDArray[np.float64]:
    """The inverse response (256,) of ``pcalib.txt``, scaled so that it goes from 0 to 255.

    Raises BadInputError when the file's first line is not 256 numbers, each larger than the one before.
    """
    rows = read_rows(path)
    if not rows:
        raise BadInputError(f"{path} is empty: it should have one line of 256 numbers, the inverse response")
    line, fields = rows[0]
    if len(fields) != 256:
        raise BadInputError(
            f"line {line} of {path} has {len(fields)} values: the inverse response has 256, one for each grey value"
        )
    values = np.array(to_numbers(path, line, fields))
    falls = np.flatnonzero(~(np.diff(values) > 0))
    if len(falls):
        raise BadInputError(
            f"the inverse response in {path} does not rise from value {falls[0]} to {falls[0] + 1}: each of the 256 numbers "
            "must be larger than the one before"
        )
    if not values[-1] - values[0] < 1e9:
        raise BadInputError(f"the inverse response in {path} reaches {values[-1]:g}: it is damaged, download it again")
    return np.asarray(255 * (values - values[0]) / (values[-1] - values[0]), np.float64)


def read_vignette(path: Path, size: tuple[int, int]) -> NDArray[np.float64]:
    """The vignette (H, W) of ``vignette.png``, an 8- or 16-bit grey image, scaled so that its largest value is 1.

    Raises BadInputError when it can't be read, is not of ``size`` (W, H) or is black.
    """
    image = read_stored(path)
    if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16):
        raise BadInputError(f"{path} is not a grey image of 8 or 16 bits: download it again")
    expect_size(image, size, str(path), "the images are", ": it is of another camera")
    if not image.any():
        raise BadInputError(f"{path} is black, as if no light came through the lens: download it again")
    return np.asarray(_filled(image) / image.max(), np.float64)


def _filled(vignette: NDArray[Any]) -> NDArray[np.float64]:
    """With 0, where the calibration saw nothing (black borders), replaced by the value of the nearest pixel that it saw."""
    seen = vignette > 0
    _, nearest = cv2.distanceTransformWithLabels(
        (~seen).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    values = np.zeros(int(np.max(nearest)) + 1)
    values[nearest[seen]] = vignette[seen]
    return np.asarray(values[nearest], np.float64)


def _rows(file: Path) -> list[tuple[int, list[str]]]:
    rows = read_rows(file)
    if len(rows) < 4:
        raise BadInputError(
            f"{file} has {len(rows)} lines, not 4: fx fy cx cy omega, the size, crop, and the size when rectified"
        )
    return rows


def _numbers(file: Path, row: tuple[int, list[str]], count: int, what: str) -> list[float]:
    line, fields = row
    if len(fields) != count:
        raise BadInputError(f"line {line} of {file} is {' '.join(fields)!r}, not {what}")
    return to_numbers(file, line, fields)


def _size(file: Path, row: tuple[int, list[str]]) -> tuple[int, int]:
    width, height = _numbers(file, row, 2, "width height")
    if min(width, height) < 2 or max(width, height) > LARGEST_SIDE or width % 1 or height % 1:
        raise BadInputError(f"line {row[0]} of {file} is no size of an image: {width:g} {height:g}")
    return int(width), int(height)


def _matrix(file: Path, line: int, values: list[float], size: tuple[int, int]) -> FloatArray:
    """In pixels, with (0, 0) at the centre of the first one, from numbers relative to the image."""
    fx, fy, cx, cy = values
    if not (fx > 0 and fy > 0 and 0 < cx < 1 and 0 < cy < 1):
        raise BadInputError(
            f"line {line} of {file} has fx fy cx cy = {fx:g} {fy:g} {cx:g} {cy:g}: relative to the image's size, the focal "
            "lengths must be positive and the centre between 0 and 1"
        )
    width, height = size
    matrix = np.array([[fx * width, 0, cx * width - 0.5], [0, fy * height, cy * height - 0.5], [0, 0, 1]], np.float64)
    expect_camera(matrix, size, file)
    return matrix

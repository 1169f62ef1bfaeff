"""Camera files of TUM mono (and DSO): a FOV camera, and what its images are to be rectified to."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sips_lit.datasets.layout import read_rows, to_numbers
from sips_lit.errors import BadInputError
from sips_lit.geometry.fov_camera import FovCamera, crop_camera, full_camera
from sips_lit.types import Camera, FloatArray


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
    if min(width, height) < 2 or width % 1 or height % 1:
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
    return np.array([[fx * width, 0, cx * width - 0.5], [0, fy * height, cy * height - 0.5], [0, 0, 1]], np.float64)

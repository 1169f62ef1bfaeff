"""Intrinsics as people have them: a camera, a matrix, four numbers, or a file with either."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.datasets.layout import expect_camera, read_table
from sips_lit.errors import BadInputError
from sips_lit.types import Camera

Intrinsics = Camera | NDArray[Any] | Sequence[Sequence[float]]
"""A camera, or its matrix (3, 3) in pixels, of images without lens distortion."""


def both_cameras(
    given: Intrinsics | Sequence[Intrinsics], shape0: tuple[int, ...], shape1: tuple[int, ...]
) -> tuple[Camera, Camera]:
    """The cameras of two images of shapes (H, W), from one for both or a list of two.

    Raises BadInputError for what is no camera of such an image.
    """
    several = isinstance(given, list | tuple) and len(given) == 2
    first, second = given if several else (given, given)  # type: ignore[misc]
    names = ("camera 0", "camera 1") if several else ("camera", "camera")
    return _camera(first, shape0, names[0]), _camera(second, shape1, names[1])


def _camera(given: Any, shape: tuple[int, ...], name: str) -> Camera:
    size = (shape[1], shape[0])
    if isinstance(given, Camera):
        if given.size != size:
            raise BadInputError(
                f"the {name} is of images of {given.size[0]}x{given.size[1]}, but this one is {size[0]}x{size[1]}: scale "
                "its focal lengths and centre with the image"
            )
        given = given.matrix
    try:
        matrix = np.asarray(given, np.float64)
    except (TypeError, ValueError) as error:
        raise BadInputError(f"the {name} is no matrix (3, 3) of numbers: {error}") from error
    if matrix.shape != (3, 3):
        raise BadInputError(f"the {name} must be a Camera or a matrix (3, 3), not of shape {matrix.shape}")
    if not np.array_equal(matrix[2], [0, 0, 1]) or matrix[1, 0] != 0:
        raise BadInputError(
            f"the {name} must be fx, s, cx; 0, fy, cy; 0, 0, 1, in pixels, but its rows are {matrix.tolist()}"
        )
    expect_camera(matrix, size, f"the {name}")
    return Camera(matrix, size)


def read_intrinsics(given: Any) -> NDArray[np.float64]:
    """The matrix (3, 3) of the numbers fx, fy, cx, cy (pixels), or of a text file of these four or of the matrix itself.

    Raises BadInputError for anything else.
    """
    if isinstance(given, str | Path):
        rows = read_table(Path(given), (3, 4))
        if rows.shape == (3, 3):
            return rows
        if rows.shape != (1, 4):
            raise BadInputError(
                f"{given} has {len(rows)} rows of {rows.shape[1]} numbers: give fx fy cx cy, or the 3x3 matrix"
            )
        given = rows[0].tolist()
    try:
        fx, fy, cx, cy = (float(value) for value in given)
    except (TypeError, ValueError) as error:
        raise BadInputError(f"camera is {given}: give [fx,fy,cx,cy] in pixels, or a text file of them") from error
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])

"""Depth maps stored as 16-bit images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sips_lit.datasets.layout import expect_size
from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_stored


def read_depth_image(path: Path, size: tuple[int, int]) -> NDArray[np.uint16]:
    """The stored values (H, W) of a depth image that must have ``size`` (W, H); 0 means unknown.

    Raises BadInputError when the file can't be read, has no 16-bit values, or is of another size.
    """
    image = read_stored(path)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise BadInputError(f"the depth map {path} has values of type {image.dtype}: it must be a grey 16-bit image")
    hint = ": depth must be registered to the image, pixel by pixel"
    expect_size(image, size, f"the depth map {path}", "its image is", hint)
    return image


def to_metres(stored: NDArray[np.uint16], unit: float) -> NDArray[np.float32]:
    """Depth (H, W) in metres; ``unit`` is the length of one step. NaN where nothing is stored."""
    depth = stored * np.float32(unit)
    depth[stored == 0] = np.nan
    return depth

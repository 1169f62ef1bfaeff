"""What resizing an image does to its pixels and its camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import Camera


def resize_map(before: tuple[int, int], after: tuple[int, int]) -> NDArray[np.float64]:
    """(3, 3) that maps pixels of an image to pixels of the image resized; sizes are (W, H).

    With (0, 0) at the centre of a pixel, x becomes (x + 0.5) s - 0.5: the outer edges of the image stay its edges. Both
    axes have their own s, since sizes are rounded to whole pixels.
    """
    sx, sy = after[0] / before[0], after[1] / before[1]
    return np.array([[sx, 0, (sx - 1) / 2], [0, sy, (sy - 1) / 2], [0, 0, 1]])


def resize_camera(camera: Camera, size: tuple[int, int]) -> Camera:
    """The camera of the image resized to ``size`` (W, H)."""
    return Camera(resize_map(camera.size, size) @ camera.matrix, size)

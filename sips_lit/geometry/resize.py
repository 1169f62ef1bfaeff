"""What resizing an image does to its camera."""

from __future__ import annotations

import numpy as np

from sips_lit.types import Camera


def resize_camera(camera: Camera, size: tuple[int, int]) -> Camera:
    """The camera of the image resized to ``size`` (W, H).

    With (0, 0) at the centre of a pixel, x becomes (x + 0.5) s - 0.5: the outer edges of the image stay its edges. Both
    axes have their own s, since sizes are rounded to whole pixels.
    """
    sx, sy = size[0] / camera.size[0], size[1] / camera.size[1]
    resized = np.array([[sx, 0, (sx - 1) / 2], [0, sy, (sy - 1) / 2], [0, 0, 1]]) @ camera.matrix
    return Camera(np.asarray(resized, np.float64), size)

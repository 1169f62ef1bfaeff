"""What resizing and mirroring images do to their pixels, and to cameras, homographies and poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import Camera, FloatArray


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


def flip_homography(
    H: FloatArray, size0: tuple[int, int], size1: tuple[int, int], horizontal: bool, vertical: bool
) -> NDArray[np.float64]:
    """The homography from image 0 to image 1, of sizes (W, H), after both were mirrored."""
    mirror0, mirror1 = (_mirror(size, horizontal, vertical) for size in (size0, size1))
    return np.asarray(mirror1 @ H @ mirror0, np.float64)  # a mirror is its own inverse


def flip_pose(T: FloatArray, horizontal: bool, vertical: bool) -> NDArray[np.float64]:
    """The motion (4, 4) between two cameras after both images, and with them the world, were mirrored."""
    mirror = np.diag([-1.0 if horizontal else 1.0, -1.0 if vertical else 1.0, 1.0, 1.0])
    return np.asarray(mirror @ T @ mirror, np.float64)


def flip_camera(camera: Camera, horizontal: bool, vertical: bool) -> Camera:
    """The camera of a mirrored image: its principal point is mirrored, its skew changes sign with one mirror."""
    mirror = _mirror(camera.size, horizontal, vertical)
    return Camera(mirror @ camera.matrix * mirror.diagonal(), camera.size)


def _mirror(size: tuple[int, int], horizontal: bool, vertical: bool) -> NDArray[np.float64]:
    mirror = np.diag([-1.0 if horizontal else 1.0, -1.0 if vertical else 1.0, 1.0])
    mirror[:2, 2] = horizontal * (size[0] - 1), vertical * (size[1] - 1)
    return mirror

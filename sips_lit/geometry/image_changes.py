"""What resizing, mirroring and transposing images do to their pixels, and to cameras, homographies and poses."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import Camera, FloatArray

_SWAP: Final = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])


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


def transpose_homography(H: FloatArray) -> NDArray[np.float64]:
    """The homography after x and y of both images were swapped."""
    return np.asarray(_SWAP @ H @ _SWAP, np.float64)


def transpose_pose(T: FloatArray) -> NDArray[np.float64]:
    """The motion (4, 4) between two cameras after x and y of both images, and with them of the world, were swapped."""
    swap = np.eye(4)
    swap[:3, :3] = _SWAP
    return np.asarray(swap @ T @ swap, np.float64)


def transpose_camera(camera: Camera) -> Camera:
    """The camera of an image whose x and y were swapped."""
    return Camera(_SWAP @ camera.matrix @ _SWAP, (camera.size[1], camera.size[0]))


def _mirror(size: tuple[int, int], horizontal: bool, vertical: bool) -> NDArray[np.float64]:
    mirror = np.diag([-1.0 if horizontal else 1.0, -1.0 if vertical else 1.0, 1.0])
    mirror[:2, 2] = horizontal * (size[0] - 1), vertical * (size[1] - 1)
    return mirror

"""Geometry of a scene that is seen in a mirror: what flips of the images do to homographies, poses and cameras."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import Camera, FloatArray


def flip_homography(
    H: FloatArray, size0: tuple[int, int], size1: tuple[int, int], horizontal: bool, vertical: bool
) -> NDArray[np.float64]:
    """The homography from image 0 to image 1, of sizes (W, H), after both were mirrored."""
    mirror0, mirror1 = (_mirror(size, horizontal, vertical) for size in (size0, size1))
    flipped: NDArray[np.float64] = mirror1 @ np.asarray(H, np.float64) @ mirror0  # a mirror is its own inverse
    return flipped


def flip_pose(T: FloatArray, horizontal: bool, vertical: bool) -> NDArray[np.float64]:
    """The motion (4, 4) between two cameras after both images, and with them the world, were mirrored."""
    mirror = np.diag([-1.0 if horizontal else 1.0, -1.0 if vertical else 1.0, 1.0, 1.0])
    flipped: NDArray[np.float64] = mirror @ np.asarray(T, np.float64) @ mirror
    return flipped


def flip_camera(camera: Camera, horizontal: bool, vertical: bool) -> Camera:
    """The camera of a mirrored image: its principal point is mirrored, its skew changes sign with one mirror."""
    width, height = camera.size
    matrix = np.array(camera.matrix, np.float64)
    if horizontal != vertical:
        matrix[0, 1] *= -1
    if horizontal:
        matrix[0, 2] = width - 1 - matrix[0, 2]
    if vertical:
        matrix[1, 2] = height - 1 - matrix[1, 2]
    return Camera(matrix, camera.size)


def _mirror(size: tuple[int, int], horizontal: bool, vertical: bool) -> NDArray[np.float64]:
    width, height = size
    mirror = np.diag([-1.0 if horizontal else 1.0, -1.0 if vertical else 1.0, 1.0])
    mirror[0, 2] = width - 1 if horizontal else 0
    mirror[1, 2] = height - 1 if vertical else 0
    return mirror

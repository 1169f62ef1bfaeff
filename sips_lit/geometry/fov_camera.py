"""The FOV camera model and the pinhole cameras that its images are rectified to.

Model: Devernay and Faugeras, "Straight lines have to be straight", Machine Vision and Applications 13 (2001): a point at
distance r from the optical axis of a pinhole camera of unit focal length appears at distance atan(2 r tan(omega / 2)) /
omega. The camera files of Engel, Usenko and Cremers (TUM mono) use it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.types import Camera, FloatArray, GreyImage


@dataclass(frozen=True, slots=True)
class FovCamera:
    """A camera of the FOV model: ``matrix`` (3, 3) in pixels, ``omega`` in radians (0: no distortion), ``size`` (W, H)."""

    matrix: FloatArray
    omega: float
    size: tuple[int, int]

    def distort(self, xy: FloatArray) -> NDArray[np.float64]:
        """Pixels (N, 2) of points (N, 2) on the plane at unit depth."""
        xy = np.asarray(xy, np.float64)
        radius = np.linalg.norm(xy, axis=1, keepdims=True)
        if self.omega > 0:
            tangent = 2 * np.tan(self.omega / 2)
            bent = np.arctan(radius * tangent) / self.omega
            # at the centre the ratio of both radii is that of the slopes
            xy = xy * np.divide(bent, radius, out=np.full_like(radius, tangent / self.omega), where=radius > 0)
        return np.asarray(xy * self.matrix.diagonal()[:2] + self.matrix[:2, 2], np.float64)

    def undistort(self, pixels: FloatArray) -> NDArray[np.float64]:
        """Points (N, 2) on the plane at unit depth that appear at pixels (N, 2).

        NaN where the ray is 90 degrees or more off the optical axis: it doesn't meet the plane.
        """
        bent = (np.asarray(pixels, np.float64) - self.matrix[:2, 2]) / self.matrix.diagonal()[:2]
        if self.omega == 0:
            return bent
        radius = np.linalg.norm(bent, axis=1, keepdims=True)
        angle, tangent = radius * self.omega, 2 * np.tan(self.omega / 2)
        straight, slope = np.tan(angle) / tangent, np.full_like(radius, self.omega / tangent)
        return np.where(angle < np.pi / 2, bent * np.divide(straight, radius, out=slope, where=radius > 0), np.nan)


def crop_camera(camera: FovCamera, size: tuple[int, int]) -> Camera:
    """The pinhole camera of ``size`` (W, H) that shows the largest rectangle without a black border.

    The distortion moves points towards the centre, the more the further out they are. So a side of the rectangle stays in
    the image when the point does where it crosses an axis, and no rectangle with the optical axis in it reaches further.
    Raises BadInputError when the image reaches 90 degrees off the optical axis, or doesn't show that axis.
    """
    (cx, cy), (width, height) = camera.matrix[:2, 2], camera.size
    if not (0 < cx < width - 1 and 0 < cy < height - 1):
        raise BadInputError(f"the optical axis is at ({cx:.1f}, {cy:.1f}), outside the {width}x{height} image")
    ends = camera.undistort(np.array([[0, cy], [width - 1, cy], [cx, 0], [cx, height - 1]]))
    if np.isnan(ends).any():
        raise BadInputError("the image reaches 90 degrees off the optical axis, which no pinhole camera shows")
    return _pinhole(ends[:2, 0], ends[2:, 1], size)


def full_camera(camera: FovCamera, size: tuple[int, int]) -> Camera:
    """The pinhole camera of ``size`` (W, H) that shows all of the image, with black borders.

    Raises BadInputError when a corner is 90 degrees or more off the optical axis, as for the wide lens of TUM mono.
    """
    width, height = camera.size
    corners = camera.undistort(np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]]))
    if np.isnan(corners).any():
        raise BadInputError("the corners are 90 degrees or more off the optical axis, which no pinhole camera shows")
    low, high = corners.min(0), corners.max(0)
    return _pinhole(np.array([low[0], high[0]]), np.array([low[1], high[1]]), size)


def _pinhole(x: FloatArray, y: FloatArray, size: tuple[int, int]) -> Camera:
    """The camera whose first and last pixel centres, along each axis, are at the two given points at unit depth."""
    fx, fy = (size[0] - 1) / (x[1] - x[0]), (size[1] - 1) / (y[1] - y[0])
    return Camera(np.array([[fx, 0, -x[0] * fx], [0, fy, -y[0] * fy], [0, 0, 1]], np.float64), size)


class Rectification:
    """Turns images of a FOV camera into those of the pinhole camera ``to``; black where the image doesn't reach."""

    def __init__(self, camera: FovCamera, to: Camera) -> None:
        width, height = to.size
        columns, rows = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
        rays = np.column_stack([columns.ravel(), rows.ravel(), np.ones(width * height)]) @ np.linalg.inv(to.matrix).T
        self._x, self._y = camera.distort(rays[:, :2]).astype(np.float32).T.reshape(2, height, width)

    def __call__(self, image: GreyImage) -> GreyImage:
        """The rectified image, by linear interpolation."""
        return np.asarray(cv2.remap(image, self._x, self._y, cv2.INTER_LINEAR), np.uint8)

"""Rectification: images of cameras with lens distortion as images of pinhole cameras, stereo rows aligned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.types import Camera, FloatArray, GreyImage

LARGEST_ZOOM = 10  # of a rectified image
MOSTLY = 0.9  # of its pixels


@dataclass(frozen=True, slots=True)
class LensCamera:
    """A camera with radial and tangential distortion: ``matrix`` (3, 3) in pixels, ``distortion`` k1, k2, p1, p2 (, k3), of
    images of ``size`` (W, H) pixels. An ``equidistant`` lens (Kannala and Brandt, PAMI 2006) has k1 to k4 instead.
    """

    matrix: FloatArray
    distortion: FloatArray
    size: tuple[int, int]
    equidistant: bool = False


@dataclass(frozen=True, slots=True)
class Rectifier:
    """Turns images of one lens camera into those of the pinhole ``camera`` at the same place.

    ``rotation`` (3, 3) maps directions of the lens camera to the pinhole camera. ``x`` and ``y`` (H, W) are the place in the
    stored image that each pixel comes from.
    """

    camera: Camera
    rotation: FloatArray
    x: NDArray[np.float32]
    y: NDArray[np.float32]

    def __call__(self, image: GreyImage) -> GreyImage:
        """The rectified image of ``camera.size``."""
        # the border mode matters where the outermost pixels come from a fraction of a pixel outside
        rectified = cv2.remap(image, self.x, self.y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(rectified, np.uint8)


def rectify_mono(lens: LensCamera) -> Rectifier:
    """An undistorted view of the same size, with square pixels and none from outside the image.

    Of an equidistant lens, which may see more than any pinhole camera, the middle in the scale that it has there.
    Raises BadInputError when there is no such view.
    """
    if lens.equidistant:
        return _rectifier(lens, np.eye(3), _kept_scale(lens))
    stretched, _ = cv2.getOptimalNewCameraMatrix(lens.matrix, lens.distortion, lens.size, 0)
    matrix = np.array(stretched, np.float64)
    matrix[0, 0] = matrix[1, 1] = max(matrix[0, 0], matrix[1, 1])  # zooms in along one axis
    return _rectifier(lens, np.eye(3), matrix)


def rectify_stereo(left: LensCamera, right: LensCamera, T_right_left: FloatArray) -> tuple[Rectifier, Rectifier, float]:
    """Rectifiers of both cameras and the baseline in the unit of ``T_right_left`` (4, 4).

    Both have one camera matrix: a point at (x, y) on the left is at (x - focal * baseline / depth, y) on the right. The zoom
    leaves no pixel from outside the images; of equidistant lenses it is as in `rectify_mono`. Raises BadInputError when the
    second camera is not to the right of the first, or a lens shows too little.
    """
    R, t = T_right_left[:3, :3], T_right_left[:3, 3]
    # the rotations do not depend on the lenses
    distortions = [np.zeros(4) if lens.equidistant else lens.distortion for lens in (left, right)]
    R0, R1, P0, P1, *_ = cv2.stereoRectify(
        left.matrix, distortions[0], right.matrix, distortions[1], left.size, R, t[:, None],
        flags=cv2.CALIB_ZERO_DISPARITY, alpha=0,
    )  # fmt: skip
    baseline = -float(P1[0, 3] / P1[0, 0])
    if not baseline > 0 or P1[1, 3] != 0:
        raise BadInputError(
            f"the second camera is not to the right of the first one but at {np.round(-R.T @ t, 3)} in its frame: rectified "
            "stereo needs the left camera first"
        )
    matrix = _kept_scale(left) if left.equidistant or right.equidistant else P0[:, :3]
    return _rectifier(left, R0, matrix), _rectifier(right, R1, matrix), baseline


def _kept_scale(lens: LensCamera) -> NDArray[np.float64]:
    """A camera matrix with square pixels of the size that those in the middle have, and the centre in the middle."""
    focal, (width, height) = float(np.sqrt(lens.matrix[0, 0] * lens.matrix[1, 1])), lens.size
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])


def _rectifier(lens: LensCamera, rotation: NDArray[Any], matrix: NDArray[Any]) -> Rectifier:
    undistort = cv2.fisheye.initUndistortRectifyMap if lens.equidistant else cv2.initUndistortRectifyMap
    x, y = undistort(lens.matrix, lens.distortion, rotation, matrix, lens.size, cv2.CV_32FC1)
    inside = (x > -1) & (x < lens.size[0]) & (y > -1) & (y < lens.size[1])
    zoom = matrix.diagonal()[:2] / lens.matrix.diagonal()[:2]
    # the zoom leaves no pixel from outside, unless numbers are damaged: OpenCV makes something of any
    if not (np.isfinite(matrix).all() and zoom.min() > 0 and zoom.max() < LARGEST_ZOOM and inside.mean() > MOSTLY):
        raise BadInputError(
            f"no pinhole camera shows the images of a lens with distortion {np.round(lens.distortion, 6)} and intrinsics "
            f"{np.round(lens.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], 3)}: correct them, or set data.rectify=false"
        )
    camera = Camera(np.asarray(matrix, np.float64), lens.size)
    return Rectifier(camera, np.asarray(rotation, np.float64), np.asarray(x), np.asarray(y))

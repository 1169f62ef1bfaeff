"""Images with registered depth maps and camera poses as a sequence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.datasets.layout import expect_size, files_fingerprint
from sips_lit.datasets.measured import MeasuredSequence
from sips_lit.errors import BadInputError
from sips_lit.files import safe_name
from sips_lit.frames.folder import FolderSequence
from sips_lit.frames.images import read_stored, resize_max_side, shrunk_size
from sips_lit.geometry.image_changes import resize_camera
from sips_lit.geometry.rectify import LensCamera, rectify_mono
from sips_lit.types import Camera, FloatArray, GreyImage

LARGEST_ZOOM = 10  # of the middle of an image, which a lens bends little


@dataclass(frozen=True, slots=True)
class RgbdFrames:
    """What an RGB-D sequence of N frames is made of.

    ``depths`` and ``poses`` (``T_world_camera``, 4x4) are None where unknown; ``times`` (N,) in seconds, or None;
    ``distortion``: (k1, k2, p1, p2, k3) of the stored images, or None if they have none; ``unit``: metres of one step of
    the depth maps; ``tables``: the other files that were read. ``equidistant``: the distortion is k1 to k4 of such a lens;
    ``cameras``: one of each frame, of the size of ``camera``, for images without distortion; ``depth_camera``: that of the
    depth maps, if another at the same place took them; ``unknown``: a stored depth that means none, besides 0.
    """

    images: list[Path]
    depths: list[Path | None]
    poses: list[FloatArray | None]
    times: list[float] | None
    camera: Camera
    distortion: tuple[float, ...] | None
    unit: float
    tables: list[Path]
    equidistant: bool = False
    cameras: Sequence[Camera] | None = None
    depth_camera: Camera | None = None
    unknown: int = 0


class RgbdSequence(MeasuredSequence):
    """Images with registered depth maps and poses. Distorted images are undistorted, and with them the depth."""

    def __init__(self, folder: Path, name: str, frames: RgbdFrames, max_side: int | None = None) -> None:
        self._images = FolderSequence(folder, frames.images)
        self.name, self.files, self.max_side = safe_name(name), frames.images, max_side
        self._frames, self._poses, self._times = frames, frames.poses, frames.times
        self.fingerprint = files_fingerprint(
            [*frames.images, *(depth for depth in frames.depths if depth), *frames.tables],
            [(depth and depth.name, pose is None) for depth, pose in zip(frames.depths, frames.poses, strict=True)],
            frames.camera.matrix.tolist(),
            frames.distortion,
            max_side,
            *_others(frames),
        )
        self._stored = frames.camera
        self._maps: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None
        pinhole = frames.camera
        if frames.distortion is not None:
            pinhole, self._maps = undistortion(frames.camera, frames.distortion, frames.equidistant)
        self._depth_maps = _looked_up(self._maps, frames.camera, frames.depth_camera)
        self._camera = resize_camera(pinhole, shrunk_size(pinhole.size, max_side))

    def frame(self, index: int) -> GreyImage:
        """Image ``index`` as grey. Raises BadInputError when it can't be read, or its size is not that of the camera."""
        image = self._images.frame(index)
        hint = ": the intrinsics are not of these images"
        expect_size(image, self._stored.size, str(self.files[index]), "its camera is for", hint)
        if self._maps is not None:
            image = np.asarray(
                cv2.remap(image, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8
            )
        return resize_max_side(image, self.max_side)

    def notes(self) -> list[str]:
        """Which values of 16-bit images are used."""
        return self._images.notes()

    def camera(self, index: int) -> Camera | None:
        """The one of all frames, or that of frame ``index``."""
        if self._frames.cameras is None:
            return self._camera
        return resize_camera(self._frames.cameras[index], shrunk_size(self._stored.size, self.max_side))

    def depth(self, index: int) -> NDArray[np.float32] | None:
        """Depth (H, W) in metres, of the size of the frame, NaN where unknown; None where there is no map.

        Shrunk maps keep the depth of the nearest pixel: a mean of foreground and background lies on neither. Raises
        BadInputError when the map can't be read or is of another size than the image.
        """
        path = self._frames.depths[index]
        if path is None:
            return None
        stored: NDArray[Any] = read_depth_image(path, (self._frames.depth_camera or self._stored).size)
        if self._frames.unknown:
            stored = np.where(stored == self._frames.unknown, 0, stored)
        if self._depth_maps is not None:
            stored = cv2.remap(stored, *self._depth_maps, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)
        size = shrunk_size(self._stored.size, self.max_side)
        if size != self._stored.size:
            stored = cv2.resize(stored, size, interpolation=cv2.INTER_NEAREST_EXACT)
        return to_metres(stored, self._frames.unit)


def _others(frames: RgbdFrames) -> list[object]:
    """What else of the frames their pixels and depths depend on."""
    cameras = [camera.matrix.tolist() for camera in frames.cameras or ()]
    depth = frames.depth_camera and (frames.depth_camera.matrix.tolist(), frames.depth_camera.size)
    return [part for part in (frames.equidistant, cameras, depth, frames.unknown) if part]


def _looked_up(
    maps: tuple[NDArray[np.float32], NDArray[np.float32]] | None, camera: Camera, depth_camera: Camera | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    """For each pixel of a frame its place (x and y, (H, W)) in a depth map; None if that is the same pixel.

    ``maps`` is its place in the stored image. Cameras at one place see a direction at fixed pixels, however far it is.
    """
    if depth_camera is None:
        return maps
    x, y = maps or np.meshgrid(*(np.arange(side, dtype=np.float32) for side in camera.size))
    A = depth_camera.matrix @ np.linalg.inv(camera.matrix)
    return np.asarray(A[0, 0] * x + A[0, 1] * y + A[0, 2], np.float32), np.asarray(A[1, 1] * y + A[1, 2], np.float32)


def undistortion(
    camera: Camera, distortion: tuple[float, ...], equidistant: bool = False
) -> tuple[Camera, tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """The camera of the undistorted images, and for each of their pixels its place (x and y, (H, W)) in a stored one.

    It sees as much as fits without pixels from outside of the stored image; of an equidistant lens see `rectify_mono`.
    Raises BadInputError for a distortion of which nothing is left then.
    """
    coefficients = np.array(distortion)
    if equidistant:
        rectifier = rectify_mono(LensCamera(camera.matrix, coefficients, camera.size, equidistant))
        return rectifier.camera, (rectifier.x, rectifier.y)
    matrix, _ = cv2.getOptimalNewCameraMatrix(camera.matrix, coefficients, camera.size, 0)
    zoom = np.diag(matrix)[:2] / np.diag(camera.matrix)[:2]
    if not np.all((zoom > 1 / LARGEST_ZOOM) & (zoom < LARGEST_ZOOM)):
        raise BadInputError(f"no pinhole camera shows the images of a lens with distortion {distortion}: correct it")
    x, y = cv2.initUndistortRectifyMap(camera.matrix, coefficients, np.eye(3), matrix, camera.size, cv2.CV_32FC1)
    return Camera(np.asarray(matrix, np.float64), camera.size), (np.asarray(x, np.float32), np.asarray(y, np.float32))


def read_depth_image(path: Path, size: tuple[int, int]) -> NDArray[Any]:
    """The stored values (H, W) of a depth image that must have ``size`` (W, H): 16 bits, or floats of an array (.npy).

    0 means unknown. Raises BadInputError when the file can't be read, has other values, or is of another size.
    """
    image = read_array(path) if path.suffix == ".npy" else read_stored(path)
    if image.ndim != 2 or not (image.dtype == np.uint16 or (path.suffix == ".npy" and image.dtype.kind == "f")):
        raise BadInputError(f"the depth map {path} has values of type {image.dtype}: it must be a grey 16-bit image")
    hint = ": depth must be registered to the image, pixel by pixel"
    expect_size(image, size, f"the depth map {path}", "its image is", hint)
    return image if image.dtype == np.uint16 else np.asarray(image, np.float32)


def read_array(path: Path) -> NDArray[Any]:
    """The array of a .npy file, mapped and not read. Raises BadInputError when it is none."""
    try:
        array: NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # a damaged header makes numpy raise almost anything
        raise BadInputError(f"{path} is no array of numpy, or is truncated or damaged: replace or remove it") from error
    return array


def to_metres(stored: NDArray[Any], unit: float) -> NDArray[np.float32]:
    """Depth (H, W) in metres; ``unit`` is the length of one step. NaN where nothing is stored."""
    depth = np.asarray(stored * np.float32(unit), np.float32)
    depth[~((stored > 0) & np.isfinite(depth))] = np.nan
    return depth

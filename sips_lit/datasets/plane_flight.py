"""Virtual flights: a smooth simulated camera over a still photograph, with exact homographies.

The photograph is a plane that goes on mirrored beyond its borders. A pinhole camera moves over it in all six degrees of
freedom along sums of slow sinusoids: there is no parallax, the truth between any two frames is a homography, and a flight
has as many frames as one likes.
"""

from __future__ import annotations

import hashlib
import itertools
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.geometry.projection import apply_homography
from sips_lit.types import FloatArray, GreyImage, ImageSequence

WAVES = 3
LARGEST_SHRINK = 1.25  # a view may cover so many photograph pixels per pixel of its own before linear sampling aliases
LARGEST_ZOOM = 2.0  # and a pixel of the photograph may cover so many pixels of the view before it looks blurred
LARGEST_MOTION = 1 / 40  # of the width: as far as an image corner may move in one frame


@dataclass(frozen=True, slots=True)
class Path6D:
    """A camera path: six coordinates as sums of sinusoids of the frame number, ``amplitude``, ``frequency`` (radians a
    frame) and ``phase``, each (6, WAVES), around ``centre`` (6,).

    The coordinates are the place on the photograph (x, y) and the logarithm of the height above it, all relative, then
    roll and two tilts in radians.
    """

    amplitude: FloatArray
    frequency: FloatArray
    phase: FloatArray
    centre: FloatArray

    def at(self, frame: int) -> NDArray[np.float64]:
        """The six coordinates (6,) at a frame."""
        waves = self.amplitude * np.sin(self.frequency * frame + self.phase)
        return np.asarray(self.centre + waves.sum(1), np.float64)


@dataclass(frozen=True, slots=True)
class PlacedCamera:
    """A camera ``height`` above ``place`` (x, y), in pixels of the photograph; ``rotation`` (3, 3) turns its rays."""

    place: tuple[float, float]
    height: float
    rotation: FloatArray


def random_path(generator: np.random.Generator) -> Path6D:
    """A path whose speed, rolls, tilts and zoom differ from flight to flight.

    The tilts stay below 0.92 radians together: then a view whose corners are 36 degrees off its axis has no horizon.
    """
    reach = np.array([1, 1, 1, *(generator.uniform(0, 1, 3) ** 2 * [1.0, 0.5, 0.5])])
    amplitude = generator.dirichlet(np.ones(WAVES), 6) * reach[:, None]
    period = np.exp(generator.uniform(np.log(80), np.log(500), (6, WAVES)))
    upright = generator.random() < 0.7
    roll = generator.normal(0, 0.1) if upright else generator.uniform(-np.pi, np.pi)
    centre = np.array([0, 0, 0, roll, *generator.uniform(-0.15, 0.15, 2)])
    return Path6D(amplitude, 2 * np.pi / period, generator.uniform(0, 2 * np.pi, (6, WAVES)), centre)


def fitted(still: GreyImage, size: tuple[int, int]) -> GreyImage:
    """The photograph, smaller if it is much larger than views of ``size`` (W, H) of it that show nearly all of it."""
    factor = LARGEST_SHRINK * size[0] / _widest(still, size)
    if factor >= 1:
        return still
    return np.asarray(cv2.resize(still, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA), np.uint8)


def _widest(still: GreyImage, size: tuple[int, int]) -> float:
    """The widest view of the photograph, in its pixels: shows nearly all of it."""
    return 0.95 * float(min(still.shape[1], still.shape[0] * size[0] / size[1]))


class Flight(ImageSequence):
    """``length`` frames of ``size`` (W, H) of a flight over ``still`` (H, W) uint8; flight number ``flight`` of a seed.

    The focal length is the longer side of the frames. No image corner moves further than about `LARGEST_MOTION`
    in one frame.
    """

    def __init__(self, still: GreyImage, name: str, size: tuple[int, int], length: int, seed: int, flight: int) -> None:
        width, height = size
        digest = hashlib.sha256(still.tobytes() + repr((still.shape, size, length, seed, flight)).encode())
        self.name, self.fingerprint = f"{name}_flight{flight}", digest.hexdigest()[:16]
        self.size, self.length = (width, height), length
        still = fitted(still, size)
        widest = _widest(still, size)
        narrowest = min(widest, max(widest / 2.5, width / LARGEST_ZOOM))
        self.still = still
        self._log_height = (np.log(widest * narrowest) / 2, np.log(widest / narrowest) / 2)
        self._focal = float(max(width, height))
        self._to_ray = np.linalg.inv(
            np.array([[self._focal, 0, (width - 1) / 2], [0, self._focal, (height - 1) / 2], [0, 0, 1]])
        )
        path = random_path(np.random.default_rng([seed, flight, *name.encode()]))
        slow_down = min(1.0, LARGEST_MOTION * width / max(self._fastest_motion(path), 1e-9))
        self._cameras = self._along(replace(path, frequency=path.frequency * slow_down))
        self._to_still = np.stack([self._to_plane(camera) for camera in self._cameras])

    def __len__(self) -> int:
        return self.length

    def frame(self, index: int) -> GreyImage:
        """Frame ``index``, rendered by one warp."""
        return self._warp(self.still, self._to_still[self._checked(index)])

    def _warp(self, image: GreyImage, to_image: NDArray[np.float64]) -> GreyImage:
        """A frame's view of an image that goes on mirrored; the homography leads from the frame to it."""
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        warped = cv2.warpPerspective(image, to_image, self.size, flags=flags, borderMode=cv2.BORDER_REFLECT_101)
        return np.asarray(warped, np.uint8)

    def _checked(self, index: int) -> int:
        if not 0 <= index < self.length:
            raise IndexError(f"frame {index} of {self.length}")
        return index

    @property
    def _nearest(self) -> float:
        """How near the nearest thing may be, as a share of the distance from the camera to the photograph's plane."""
        return 1.0

    def _fastest_motion(self, path: Path6D) -> float:
        """The furthest that a corner of the image moves in one frame (pixels), were it at the nearest thing."""
        width, height = self.size
        corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], np.float64)
        cameras = self._along(path)
        elevation = (1 - self._nearest) * min(camera.height for camera in cameras)
        to_plane = [self._to_plane(camera, elevation) for camera in cameras]
        to_next = [np.linalg.solve(later, earlier) for earlier, later in itertools.pairwise(to_plane)]
        steps = [apply_homography(H, corners) - corners for H in to_next]
        return float(np.linalg.norm(steps, axis=2).max()) if steps else 0.0

    def _along(self, path: Path6D) -> list[PlacedCamera]:
        """The camera of every frame."""
        return [self._camera(path.at(index)) for index in range(self.length)]

    def _camera(self, coordinates: NDArray[np.float64]) -> PlacedCamera:
        """The camera at the six coordinates of a path."""
        x, y, z, roll, tilt_x, tilt_y = coordinates
        view = float(np.exp(self._log_height[0] + z * self._log_height[1]))  # pixels of the photograph across the view
        height, width = self.still.shape
        reach_x, reach_y = (max(0.25 * view, (side - view) / 2) for side in (width, height))
        rotation, _ = cv2.Rodrigues(np.array([tilt_x, tilt_y, 0.0]))
        spin, _ = cv2.Rodrigues(np.array([0.0, 0.0, roll]))
        return PlacedCamera(
            ((width - 1) / 2 + x * reach_x, (height - 1) / 2 + y * reach_y),
            view * self._focal / self.size[0],
            np.asarray(rotation @ spin, np.float64),
        )

    def _to_plane(self, camera: PlacedCamera, elevation: float = 0.0) -> NDArray[np.float64]:
        """Homography (3, 3) from pixels of a frame to a plane parallel to the photograph, in pixels of the latter."""
        away = camera.height - elevation
        plane = np.array([[away, 0, camera.place[0]], [0, away, camera.place[1]], [0, 0, 1]])
        return np.asarray(plane @ camera.rotation @ self._to_ray, np.float64)


class VirtualFlight(Flight):
    """A flight over nothing but the photograph's plane, with exact homographies."""

    def homography(self, index0: int, index1: int) -> FloatArray:
        """(3, 3) float64 from pixels of one frame to pixels of another, exact, with H[2, 2] = 1."""
        H: FloatArray = np.linalg.solve(self._to_still[self._checked(index1)], self._to_still[self._checked(index0)])
        return np.asarray(H / H[2, 2], np.float64)

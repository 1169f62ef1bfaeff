"""Virtual flights: a smooth simulated camera over a still photograph, with exact homographies.

The photograph is a plane that goes on mirrored beyond its borders. A pinhole camera moves over it in all six degrees of
freedom along sums of slow sinusoids: there is no parallax, the truth between any two frames is a homography, and a flight
has as many frames as one likes.
"""

from __future__ import annotations

import hashlib
import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.files import safe_name
from sips_lit.frames.images import read_grey
from sips_lit.frames.listing import list_images
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


class VirtualFlight(ImageSequence):
    """``length`` frames of ``size`` (W, H) of a flight over ``still`` (H, W) uint8; flight number ``flight`` of a seed.

    The focal length is the longer side of the frames. No image corner moves further than about `LARGEST_MOTION`
    in one frame.
    """

    def __init__(self, still: GreyImage, name: str, size: tuple[int, int], length: int, seed: int, flight: int) -> None:
        width, height = size
        digest = hashlib.sha256(still.tobytes() + repr((still.shape, size, length, seed, flight)).encode())
        self.name, self.fingerprint = f"{name}_flight{flight}", digest.hexdigest()[:16]
        self.size, self.length = (width, height), length
        # the widest view shows nearly all of the photograph; one that is much larger than the view is shrunk before
        widest = 0.95 * min(still.shape[1], still.shape[0] * width / height)
        if widest > LARGEST_SHRINK * width:
            factor = LARGEST_SHRINK * width / widest
            still = np.asarray(cv2.resize(still, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA), np.uint8)
            widest = LARGEST_SHRINK * width
        narrowest = min(widest, max(widest / 2.5, width / LARGEST_ZOOM))
        self.still = still
        self._log_height = (np.log(widest * narrowest) / 2, np.log(widest / narrowest) / 2)
        self._focal = float(max(width, height))
        self._to_ray = np.linalg.inv(
            np.array([[self._focal, 0, (width - 1) / 2], [0, self._focal, (height - 1) / 2], [0, 0, 1]])
        )
        path = random_path(np.random.default_rng([seed, flight, *name.encode()]))
        slow_down = min(1.0, LARGEST_MOTION * width / max(self._fastest_motion(path), 1e-9))
        self._to_still = self._along(replace(path, frequency=path.frequency * slow_down))

    def __len__(self) -> int:
        return self.length

    def frame(self, index: int) -> GreyImage:
        """Frame ``index``, rendered by one warp."""
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        to_still = self._to_still[self._checked(index)]
        warped = cv2.warpPerspective(self.still, to_still, self.size, flags=flags, borderMode=cv2.BORDER_REFLECT_101)
        return np.asarray(warped, np.uint8)

    def homography(self, index0: int, index1: int) -> FloatArray:
        """(3, 3) float64 from pixels of one frame to pixels of another, exact, with H[2, 2] = 1."""
        H: FloatArray = np.linalg.solve(self._to_still[self._checked(index1)], self._to_still[self._checked(index0)])
        return np.asarray(H / H[2, 2], np.float64)

    def _checked(self, index: int) -> int:
        if not 0 <= index < self.length:
            raise IndexError(f"frame {index} of {self.length}")
        return index

    def _fastest_motion(self, path: Path6D) -> float:
        """The furthest that a corner of the image moves in one frame (pixels)."""
        width, height = self.size
        corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], np.float64)
        to_next = [np.linalg.solve(later, earlier) for earlier, later in itertools.pairwise(self._along(path))]
        steps = [apply_homography(H, corners) - corners for H in to_next]
        return float(np.linalg.norm(steps, axis=2).max()) if steps else 0.0

    def _along(self, path: Path6D) -> NDArray[np.float64]:
        """For every frame the homography (length, 3, 3) from its pixels to pixels of the photograph."""
        return np.stack([self._map(path.at(index)) for index in range(self.length)])

    def _map(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Homography (3, 3) from pixels of a frame to pixels of the photograph, for the six coordinates of the camera."""
        x, y, z, roll, tilt_x, tilt_y = coordinates
        view = float(np.exp(self._log_height[0] + z * self._log_height[1]))  # pixels of the photograph across the view
        height, width = self.still.shape
        reach_x, reach_y = (max(0.25 * view, (side - view) / 2) for side in (width, height))
        place = ((width - 1) / 2 + x * reach_x, (height - 1) / 2 + y * reach_y)
        magnify = view * self._focal / self.size[0]
        plane = np.array([[magnify, 0, place[0]], [0, magnify, place[1]], [0, 0, 1]])
        rotation, _ = cv2.Rodrigues(np.array([tilt_x, tilt_y, 0.0]))
        spin, _ = cv2.Rodrigues(np.array([0.0, 0.0, roll]))
        return np.asarray(plane @ rotation @ spin @ self._to_ray, np.float64)


def virtual_flight(
    path: str | Path,
    size: tuple[int, int] = (480, 360),
    length: int = 80,
    flights_per_still: int = 4,
    seed: int = 0,
) -> list[ImageSequence]:
    """Flights over the photograph ``path``, or all those of a folder. See `flights_over`.

    Raises BadInputError when there is no photograph.
    """
    path = Path(path)
    if not path.exists():
        raise BadInputError(f"there is no image or folder {path} to fly over: set data.path")
    files = list_images(path) if path.is_dir() else [path]
    stems = Counter(file.stem for file in files)
    names = [file.stem if stems[file.stem] == 1 else file.name for file in files]
    stills = [(safe_name(name), read_grey(file)) for name, file in zip(names, files, strict=True)]
    return flights_over(stills, size, length, flights_per_still, seed)


def flights_over(
    stills: Sequence[tuple[str, GreyImage]],
    size: tuple[int, int] = (480, 360),
    length: int = 80,
    flights_per_still: int = 4,
    seed: int = 0,
) -> list[ImageSequence]:
    """``flights_per_still`` flights over each (name, photograph): ``length`` frames of ``size`` (W, H).

    Raises BadInputError when there is no photograph, one is too small to fly over, or a number is out of range.
    """
    width, height = (int(side) for side in size)
    if min(width, height) < 16 or length < 2 or flights_per_still < 1 or seed < 0:
        raise BadInputError(
            "flights need a size of at least 16x16, length >= 2, flights_per_still >= 1 and seed >= 0, not "
            f"{width}x{height}, {length}, {flights_per_still} and {seed}"
        )
    if not stills:
        raise BadInputError("there are no photographs to fly over: give an image, or a folder of images")
    for name, still in stills:
        if min(still.shape) < 32:
            raise BadInputError(f"the photograph {name} is {still.shape[1]}x{still.shape[0]}: too small to fly over")
    return [
        VirtualFlight(still, name, (width, height), length, seed, flight)
        for name, still in stills
        for flight in range(flights_per_still)
    ]

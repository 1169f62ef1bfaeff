"""Virtual flights over layers: photographs with pieces of others afloat above them, so that things hide each other.

Real video is full of outlines: they match from image to image, but where one thing hides another they are no places of the
scene. A plane has none. Here planes at several depths, with ragged holes, are seen by one moving camera; pose and depth of
every pixel are exact.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.datasets.plane_flight import Flight, PlacedCamera, fitted
from sips_lit.types import Camera, FloatArray, GreyImage

NEAREST = (
    0.35  # of the distance to the photograph behind: the nearest that a layer may be at the lowest point of a flight
)
COVER = (0.15, 0.4)  # how much of the view a layer covers
PIECE = (0.12, 0.4)  # how wide its pieces are, in widths of the view
STRIPS = 0.4  # share of the layers that are a net of strips, like branches; the others are blobs
BARE = 0.25  # share of the flights whose background is bare, like a sky


@dataclass(frozen=True, slots=True)
class Layer:
    """A photograph (H, W) with holes: ``cover`` (H, W) uint8 is 255 where it is, 0 where one sees through it.

    It goes on mirrored beyond its borders and is parallel to the background, ``elevation`` above it. ``scale`` of its pixels
    are one of the background; ``shift`` (x, y) in its own pixels says where it lies.
    """

    texture: GreyImage
    cover: GreyImage
    elevation: float
    scale: float
    shift: tuple[float, float]


class LayeredFlight(Flight):
    """A flight with 1 to ``layers`` layers of ``others`` between; it has no homography, but poses and depth.

    Distances are in widths of the background photograph as the flight uses it.
    """

    def __init__(
        self,
        still: GreyImage,
        name: str,
        size: tuple[int, int],
        length: int,
        seed: int,
        flight: int,
        layers: int,
        others: Sequence[GreyImage],
    ) -> None:
        super().__init__(still, name, size, length, seed, flight)
        generator = np.random.default_rng([seed, flight, layers, *name.encode()])
        if generator.random() < BARE:
            self.still = _bare(self.still, generator)
        self._unit = float(self.still.shape[1])
        lowest = min(camera.height for camera in self._cameras)
        count = generator.integers(1, layers, endpoint=True)
        elevations = np.sort(generator.uniform(0.1, 1 - NEAREST, count)) * lowest
        self._layers = [self._layer(others, float(elevation), generator) for elevation in elevations]
        digest = hashlib.sha256(self.fingerprint.encode())
        for layer in self._layers:
            digest.update(
                layer.texture.tobytes() + layer.cover.tobytes() + repr((layer.elevation, layer.shift)).encode()
            )
        self.name, self.fingerprint = f"{name}_layers{flight}", digest.hexdigest()[:16]

    def frame(self, index: int) -> GreyImage:
        """Frame ``index``: every layer by one warp, the nearest last."""
        picture = super().frame(index).astype(np.float32)
        for layer in self._layers:
            to_layer = self._to_layer(self._cameras[index], layer)
            cover = self._warp(layer.cover, to_layer).astype(np.float32) / 255
            picture += cover * (self._warp(layer.texture, to_layer) - picture)
        return np.asarray(np.rint(picture), np.uint8)

    def camera(self, index: int) -> Camera:
        """The same for all frames."""
        return Camera(np.linalg.inv(self._to_ray), self.size)

    def pose(self, index: int) -> FloatArray:
        """Exact; the background is the plane z = 0, seen along z."""
        camera = self._cameras[self._checked(index)]
        pose = np.eye(4)
        pose[:3, :3] = camera.rotation
        pose[:3, 3] = [camera.place[0] / self._unit, camera.place[1] / self._unit, -camera.height / self._unit]
        return pose

    def depth(self, index: int) -> FloatArray:
        """Exact for the ray through the centre of each pixel; at an outline that of what covers more than half of it."""
        camera = self._cameras[self._checked(index)]
        width, height = self.size
        row = (camera.rotation @ self._to_ray)[2]  # how far a ray of one unit of depth goes down
        down = row[0] * np.arange(width) + (row[1] * np.arange(height) + row[2])[:, None]
        away = np.full((height, width), camera.height)
        for layer in self._layers:
            away[self._warp(layer.cover, self._to_layer(camera, layer)) > 127] = camera.height - layer.elevation
        return np.asarray(away / self._unit / down, np.float32)

    @property
    def _nearest(self) -> float:
        return NEAREST

    def _layer(self, others: Sequence[GreyImage], elevation: float, generator: np.random.Generator) -> Layer:
        """A layer of a random photograph; about as sharp as the background at the middle of the flight."""
        texture = fitted(others[int(generator.integers(len(others)))], self.size)
        gain, offset = generator.uniform(0.5, 1.1), generator.uniform(-40, 40)
        texture = np.asarray(np.clip(gain * texture.astype(np.float32) + offset, 0, 255), np.uint8)
        middle = float(np.median([camera.height for camera in self._cameras]))
        scale = middle / (middle - elevation)
        shift = tuple(generator.uniform(0, 2 * np.array(texture.shape[::-1])).tolist())
        return Layer(
            texture,
            ragged_cover(texture.shape, self.size[0] * generator.uniform(*PIECE), generator),
            elevation,
            scale,
            (shift[0], shift[1]),
        )

    def _to_layer(self, camera: PlacedCamera, layer: Layer) -> NDArray[np.float64]:
        """Homography (3, 3) from pixels of a frame to pixels of a layer."""
        x, y = layer.shift
        onto = np.array([[layer.scale, 0, x], [0, layer.scale, y], [0, 0, 1]])
        return np.asarray(onto @ self._to_plane(camera, layer.elevation), np.float64)


def ragged_cover(shape: tuple[int, int], cell: float, generator: np.random.Generator) -> GreyImage:
    """A mask (H, W) uint8, 255 in blobs or in a net of strips with outlines from smooth to ragged, 0 elsewhere.

    Noise of several scales, from ``cell`` pixels down, above a threshold or near its median; the rougher, the stronger its
    fine scales.
    """
    height, width = shape
    roughness = generator.uniform(0.3, 0.9)
    noise, strength = np.zeros(shape, np.float32), 1.0
    while cell > 8:
        coarse = generator.standard_normal((max(2, round(height / cell)), max(2, round(width / cell))), np.float32)
        noise += np.float32(strength) * cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
        cell, strength = cell / 2, strength * roughness
    if generator.random() < STRIPS:
        noise = -np.abs(noise - np.median(noise))
    threshold = np.quantile(noise, 1 - generator.uniform(*COVER))
    return np.asarray(np.where(noise > threshold, 255, 0), np.uint8)


def _bare(still: GreyImage, generator: np.random.Generator) -> GreyImage:
    """What is left of a photograph without its texture: slow changes of grey, brighter or darker."""
    blurred = cv2.GaussianBlur(still, (0, 0), still.shape[1] / 8).astype(np.float32)
    return np.asarray(np.clip(blurred + generator.uniform(-60, 120), 0, 255), np.uint8)

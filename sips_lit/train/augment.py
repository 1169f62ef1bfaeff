"""Augmentation that keeps labels right."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.geometry.image_changes import (
    flip_camera,
    flip_homography,
    flip_pose,
    transpose_camera,
    transpose_homography,
    transpose_pose,
)
from sips_lit.types import FramePair, GreyImage, ViewGeometry

SHARPNESS = 0.5  # pixels: the standard deviation of the blur that one pixel is taken to have


@dataclass(frozen=True, slots=True)
class Augmentation:
    """Random mirrors, transposes and negatives of a pair, turns and scales of planar images, sizes, photometric changes.

    Trackers keep the clean frames, so a label says that the place is the same though it looks different. ``flip``:
    probability of each mirror; ``transpose``: that x and y are swapped; ``invert``: that both images are negatives;
    ``log2_shrink``: powers of two by which both images become smaller at most, and ``log2_zoom`` each by itself;
    ``photometric``: probability that an image is changed; the rest are the largest changes: ``contrast`` and ``gamma`` as
    factors, ``brightness`` and ``noise`` (standard deviation) in grey values, ``blur`` as standard deviation in pixels,
    ``shade`` as relative change of the light across the image, ``rotation`` in radians and ``log2_scale`` as power of two
    (our choice). Raises BadInputError for what is no probability, or no size of a change.
    """

    flip: float = 0.5
    transpose: float = 0.0
    invert: float = 0.0
    log2_shrink: float = 0.0
    log2_zoom: float = 0.0
    photometric: float = 0.7
    contrast: float = 1.6
    gamma: float = 1.5
    brightness: float = 30.0
    noise: float = 6.0
    blur: float = 1.2
    shade: float = 0.5
    rotation: float = 0.0
    log2_scale: float = 0.0

    def __post_init__(self) -> None:
        for name in ("flip", "transpose", "invert", "photometric"):
            if not 0 <= getattr(self, name) <= 1:
                raise BadInputError(
                    f"{name} of the augmentation is a probability from 0 to 1, not {getattr(self, name)}"
                )
        for name in ("log2_shrink", "log2_zoom", "brightness", "noise", "blur", "shade", "rotation", "log2_scale"):
            if not getattr(self, name) >= 0:
                raise BadInputError(f"{name} of the augmentation is 0 or more, not {getattr(self, name)}")
        for name in ("contrast", "gamma"):
            if not getattr(self, name) > 0:
                raise BadInputError(f"{name} of the augmentation is a factor above 0, not {getattr(self, name)}")

    def __call__(self, pair: FramePair, generator: np.random.Generator, planar: bool = False) -> FramePair:
        """Another pair; the same generator state gives the same one.

        ``planar``: the labels need the pair's homography and neither frames between nor depth. Only then, and only where
        the pair has a homography and no other geometry, is each image turned and scaled by itself.
        """
        pair = mirror_pair(pair, generator.random() < self.flip, generator.random() < self.flip)
        if self.transpose and generator.random() < self.transpose:
            pair = transpose_pair(pair)
        if planar and (self.rotation or self.log2_scale) and pair.homography is not None and pair.geometry is None:
            angle = generator.uniform(-self.rotation, self.rotation, 2)
            scale = 2 ** generator.uniform(-self.log2_scale, self.log2_scale, 2)
            pair = turn_and_scale_pair(pair, (angle[0], angle[1]), (scale[0], scale[1]))
        if self.log2_shrink or self.log2_zoom:
            shrink = generator.uniform(0, self.log2_shrink) + generator.uniform(0, self.log2_zoom, 2)
            pair = shrink_images(pair, *(2**shrink).tolist())
        if self.invert and generator.random() < self.invert:
            pair = replace(pair, image0=255 - pair.image0, image1=255 - pair.image1)
        images = (
            self.change_light(image, generator) if generator.random() < self.photometric else image
            for image in (pair.image0, pair.image1)
        )
        return replace(pair, image0=next(images), image1=next(images))

    def change_shape(self, image: GreyImage, generator: np.random.Generator) -> GreyImage:
        """A single image (H, W) uint8 without labels, mirrored, transposed, turned, scaled and shrunk at random."""
        mirrored = [generator.random() < self.flip for _ in range(2)]
        image = image[tuple(slice(None, None, -1 if axis else 1) for axis in mirrored)]
        if self.transpose and generator.random() < self.transpose:
            image = image.T
        image = np.ascontiguousarray(image)
        if self.rotation or self.log2_scale:
            angle = generator.uniform(-self.rotation, self.rotation)
            image, _ = turn_and_scale(image, angle, 2 ** generator.uniform(-self.log2_scale, self.log2_scale))
        if self.log2_shrink or self.log2_zoom:
            image = shrink(image, 2 ** generator.uniform(0, self.log2_shrink + self.log2_zoom))
        return image

    def change_look(self, image: GreyImage, generator: np.random.Generator) -> GreyImage:
        """A single image (H, W) uint8 without labels as it is, or as a negative or photometrically changed, at random."""
        if self.invert and generator.random() < self.invert:
            image = 255 - image
        return self.change_light(image, generator) if generator.random() < self.photometric else image

    def change_light(self, image: GreyImage, generator: np.random.Generator) -> GreyImage:
        """A photometrically changed copy of an image (H, W) uint8."""
        height, width = image.shape
        u = generator.uniform(-1, 1, 6)
        grey = np.linspace(0, 1, 256) ** (self.gamma ** u[0])
        tone_curve = ((grey - 0.5) * self.contrast ** u[1] + 0.5) * 255 + self.brightness * u[2]
        x = cv2.LUT(image, tone_curve.astype(np.float32))
        angle, shade = np.pi * u[3], self.shade * abs(u[4])
        across = np.cos(angle) * np.linspace(-1, 1, width, dtype=np.float32)
        down = np.sin(angle) * np.linspace(-1, 1, height, dtype=np.float32)
        x = x * (1 + shade * (down[:, None] + across[None, :]) / np.sqrt(2))
        sigma = self.blur * abs(u[5])
        if sigma > 0.3:
            x = cv2.GaussianBlur(x, (0, 0), sigma)
        noise = np.float32(self.noise * generator.random())
        x = x + generator.standard_normal(image.shape, np.float32) * noise
        return np.asarray(np.clip(x + 0.5, 0, 255), np.uint8)


def mirror_pair(pair: FramePair, horizontal: bool, vertical: bool) -> FramePair:
    """The pair as a mirror shows it: all frames, and the homography or pose, cameras and depth that are known."""
    if not (horizontal or vertical):
        return pair

    turned = slice(None, None, -1 if vertical else 1), slice(None, None, -1 if horizontal else 1)

    def mirror(image: Any) -> Any:
        return None if image is None else np.ascontiguousarray(image[turned])

    H, g = pair.homography, pair.geometry
    if H is not None:
        size0, size1 = ((image.shape[1], image.shape[0]) for image in (pair.image0, pair.image1))
        H = flip_homography(H, size0, size1, horizontal, vertical)
    if g is not None:
        g = ViewGeometry(
            T_1_0=None if g.T_1_0 is None else flip_pose(g.T_1_0, horizontal, vertical),
            camera0=flip_camera(g.camera0, horizontal, vertical),
            camera1=flip_camera(g.camera1, horizontal, vertical),
            depth0=mirror(g.depth0),
            depth1=mirror(g.depth1),
            right0=mirror(g.right0),
            right1=mirror(g.right1),
            baseline=-g.baseline if horizontal and g.baseline is not None else g.baseline,
        )
    frames = tuple(mirror(frame) for frame in pair.frames)
    return replace(
        pair, frames=frames, image0=mirror(pair.image0), image1=mirror(pair.image1), homography=H, geometry=g
    )


def transpose_pair(pair: FramePair) -> FramePair:
    """The pair with x and y of all images swapped, and with them what is known about it.

    A pair with stereo partners stays as it is: their rows would become columns.
    """
    H, g = pair.homography, pair.geometry
    if g is not None and (g.right0 is not None or g.right1 is not None):
        return pair

    def transpose(image: Any) -> Any:
        return None if image is None else np.ascontiguousarray(image.T)

    if g is not None:
        g = replace(
            g,
            T_1_0=None if g.T_1_0 is None else transpose_pose(g.T_1_0),
            camera0=transpose_camera(g.camera0),
            camera1=transpose_camera(g.camera1),
            depth0=transpose(g.depth0),
            depth1=transpose(g.depth1),
        )
    return replace(
        pair,
        frames=tuple(map(transpose, pair.frames)),
        image0=transpose(pair.image0),
        image1=transpose(pair.image1),
        homography=None if H is None else transpose_homography(H),
        geometry=g,
    )


def shrink_images(pair: FramePair, factor0: float, factor1: float) -> FramePair:
    """The pair with its two images made smaller by factors >= 1; its frames and what is known about them stay.

    `sips_lit.train.labelling.label_pair` finds the points of a smaller image in its frame.
    """
    return replace(pair, image0=shrink(pair.image0, factor0), image1=shrink(pair.image1, factor1))


def shrink(image: GreyImage, factor: float) -> GreyImage:
    """The image (H, W) made smaller by a factor >= 1."""
    size = max(1, round(image.shape[1] / factor)), max(1, round(image.shape[0] / factor))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def turn_and_scale(image: GreyImage, angle: float, scale: float) -> tuple[GreyImage, NDArray[np.float64]]:
    """The image (H, W) turned by ``angle`` radians (from x to y) and scaled about its centre, and its map (3, 3).

    The result is cut to the largest upright rectangle inside the turned image and grows or shrinks with the scale. So no
    pixel comes from outside of the photograph: filled corners would have edges that turn with the image and match like
    texture, and a mirrored fill shows real texture with wrong labels. What the cut costs is area: at 1 radian
    it leaves two fifths of a 4:3 image.
    """
    height, width = image.shape
    across, down = _largest_inside(width - 1, height - 1, angle)  # from pixel centre to pixel centre
    size = (math.floor(scale * across) + 1, math.floor(scale * down) + 1)
    c, s = scale * math.cos(angle), scale * math.sin(angle)
    A = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    A[:2, 2] = (np.array(size) - 1) / 2 - A[:2, :2] @ [(width - 1) / 2, (height - 1) / 2]
    if scale < 1:  # else fine texture aliases
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), SHARPNESS * math.sqrt(scale**-2 - 1)), np.uint8)
    turned = cv2.warpAffine(image, A[:2], size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(turned, np.uint8), A


def turn_and_scale_pair(pair: FramePair, angles: tuple[float, float], scales: tuple[float, float]) -> FramePair:
    """The pair with each of its two images turned and scaled by itself; its homography follows exactly.

    Raises ValueError for a pair without a homography, and one with more than that: frames between, poses or depth.
    """
    if pair.homography is None or pair.geometry is not None or len(pair.frames) != 2:
        raise ValueError(
            f"{pair.name}: only the two images of a pair that nothing but a homography joins can be turned"
        )
    image0, A0 = turn_and_scale(pair.image0, angles[0], scales[0])
    image1, A1 = turn_and_scale(pair.image1, angles[1], scales[1])
    H = A1 @ pair.homography @ np.linalg.inv(A0)
    return replace(pair, frames=(image0, image1), image0=image0, image1=image1, homography=H)


def _largest_inside(width: float, height: float, angle: float) -> tuple[float, float]:
    """Width and height of the upright rectangle of largest area inside a rectangle that is turned about its centre."""
    s, c = abs(math.sin(angle)), abs(math.cos(angle))
    short, long = min(width, height), max(width, height)
    if short <= 2 * s * c * long:  # two corners touch the long sides, the others lie inside
        across, down = (short / 2 / s, short / 2 / c) if width >= height else (short / 2 / c, short / 2 / s)
        return across, down
    cos_double = c * c - s * s  # all four corners touch
    return (width * c - height * s) / cos_double, (height * c - width * s) / cos_double

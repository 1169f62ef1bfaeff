"""Small images with true geometry, made for the tests: a smooth random texture and a flight over it."""

import functools
import hashlib
from collections.abc import Sequence

import cv2
import numpy as np

from sips_lit.errors import BadInputError
from sips_lit.geometry.projection import apply_homography
from sips_lit.types import FramePair, GreyImage, ImageSequence, Keypoints, Matches


def texture(height: int, width: int, seed: int = 0) -> GreyImage:
    """Noise at several scales: blobs and corners everywhere, smooth enough for KLT."""
    generator = np.random.default_rng(seed)
    total = np.zeros((height, width))
    for sigma in (1.5, 3, 6, 12):
        layer = cv2.GaussianBlur(generator.standard_normal((height, width)), (0, 0), sigma)
        total += layer / max(layer.std(), 1e-9)
    return np.clip(127 + 30 * total, 0, 255).astype(np.uint8)


class ArraySequence(ImageSequence):
    """Frames from memory; ``to_frame[i]`` (3, 3) maps a plane to pixels of frame i. Counts how often a frame is read."""

    def __init__(
        self, frames: Sequence[GreyImage], name: str = "scene", to_frame: Sequence[np.ndarray] | None = None
    ) -> None:
        self.frames, self.name, self.to_frame = list(frames), name, to_frame
        self.fingerprint = hashlib.sha256(b"".join(f.tobytes() for f in self.frames)).hexdigest()
        self.reads = 0

    def __len__(self) -> int:
        return len(self.frames)

    def frame(self, index: int) -> GreyImage:
        self.reads += 1
        return self.frames[index]

    def homography(self, index0: int, index1: int) -> np.ndarray | None:
        return None if self.to_frame is None else self.to_frame[index1] @ np.linalg.inv(self.to_frame[index0])


class Damaged(ArraySequence):
    """Frames ``bad`` can't be read."""

    bad: tuple[int, ...] = ()

    def frame(self, index):
        if index in self.bad:
            raise BadInputError(f"{index}.png is damaged")
        return super().frame(index)


def flight(
    count: int = 12,
    step: tuple[float, float] = (2.3, -1.1),
    zoom: float = 1.01,
    size: tuple[int, int] = (160, 120),
    seed: int = 0,
    name: str = "flight",
    known: bool = True,
) -> ArraySequence:
    """A camera that moves by ``step`` pixels and zooms by ``zoom`` in every frame over one big texture.

    The sequence tells its homographies only if they are ``known``.
    """
    width, height = size
    plane = texture(3 * height, 3 * width, seed)
    frames, to_frame = [], []
    for i in range(count):
        scale = zoom**i
        # the centre of the plane, moved by i steps, is seen in the middle of the frame
        x, y = 1.5 * width + i * step[0], 1.5 * height + i * step[1]
        A = np.array([[scale, 0, width / 2 - scale * x], [0, scale, height / 2 - scale * y], [0, 0, 1.0]])
        frames.append(cv2.warpPerspective(plane, A, size, flags=cv2.INTER_CUBIC))
        to_frame.append(A)
    return ArraySequence(frames, name, to_frame if known else None)


film = functools.partial(flight, known=False)


def keypoints(xy: object, score: object = None, scale: float = 1.0) -> Keypoints:
    """Points with descending scores, if none are given."""
    places = np.asarray(xy, np.float32).reshape(-1, 2)
    scores = np.linspace(0.9, 0.1, len(places)) if score is None else np.asarray(score)
    return Keypoints(places, scores.astype(np.float32), np.full(len(places), scale, np.float32))


def near_and_far(pair: FramePair) -> tuple[np.ndarray, np.ndarray, Matches]:
    """80 places in image 0 of a 160 x 120 pair, in image 1 those 1 or 6 pixels from the true ones, and their matches."""
    generator = np.random.default_rng(0)
    start = generator.uniform([25, 25], [135, 95], (80, 2))
    off = np.where(generator.random(80) < 0.5, 1.0, 6.0)  # clearly near and clearly far
    goal = apply_homography(pair.homography, start) + off[:, None] * [0.6, 0.8]
    return start, goal, Matches(np.arange(80), np.arange(80))

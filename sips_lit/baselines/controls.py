"""Controls: points that ignore the image. A detector that does not beat them has learned nothing."""

from __future__ import annotations

import math
import zlib

import numpy as np

from sips_lit.detect.base import BaseDetector
from sips_lit.types import FloatArray, GreyImage, Keypoints


class RandomPoints(BaseDetector):
    """Uniformly random sub-pixel points: the same for the same image and ``seed``, and fewer are a part of more."""

    name = "random"

    def __init__(self, seed: int = 0) -> None:
        """Draw by ``seed`` and the image's content."""
        self.seed = seed

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """``n`` points; the score says their order and nothing else."""
        height, width = image.shape
        generator = np.random.default_rng([self.seed, zlib.crc32(image.tobytes())])
        return _in_this_order(generator.random((max(n, 0), 2)) * (width - 1, height - 1))


class GridPoints(BaseDetector):
    """Points of a regular grid, in a fixed random order, so that the first few are spread over the image, too."""

    name = "grid"

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """``n`` points; the score says their order and nothing else."""
        if n <= 0:
            return Keypoints.empty()
        height, width = image.shape
        columns = math.ceil(math.sqrt(n * width / height))
        rows = math.ceil(n / columns)
        x = (np.arange(columns) + 0.5) * width / columns - 0.5
        y = (np.arange(rows) + 0.5) * height / rows - 0.5
        grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return _in_this_order(np.random.default_rng([rows, columns]).permutation(grid)[:n])


def _in_this_order(xy: FloatArray) -> Keypoints:
    score = (1 / np.arange(1, len(xy) + 1)).astype(np.float32)
    return Keypoints(xy.astype(np.float32), score, np.ones(len(xy), np.float32))

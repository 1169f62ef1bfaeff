"""A camera that moves along a textured wall: everything about it is known, and can be told or kept secret."""

import numpy as np
from textured_scenes import texture

from sips_lit.types import Camera, ImageSequence

FOCAL, DISTANCE = 100.0, 10.0  # pixels, metres: a metre is 10 pixels
SIZE = (160, 120)


class Wall(ImageSequence):
    """Frame i is ``step`` * i pixels further to the right, and half as many further down."""

    def __init__(self, count: int = 6, step: int = 8, *, poses=True, depth=True, stereo=False, name="wall", seed=0):
        self.count, self.step, self.name, self.fingerprint = count, step, name, f"{name}{count}{step}{seed}"
        self.tells_poses, self.tells_depth, self.tells_stereo = poses, depth, stereo
        self.wall = texture(SIZE[1] + count * step, SIZE[0] + (count + 4) * step, seed)
        self.reads = 0

    def __len__(self):
        return self.count

    def _crop(self, x, y):
        return self.wall[y : y + SIZE[1], x : x + SIZE[0]]

    def frame(self, index):
        self.reads += 1
        return self._crop(self.step * index, self.step * index // 2)

    def camera(self, index):
        return Camera(np.array([[FOCAL, 0, 80], [0, FOCAL, 60], [0, 0, 1]]), SIZE)

    def pose(self, index):
        if not self.tells_poses:
            return None
        T = np.eye(4)
        T[:2, 3] = np.array([self.step * index, self.step * index // 2]) * DISTANCE / FOCAL
        return T

    def depth(self, index):
        return np.full(SIZE[::-1], DISTANCE, np.float32) if self.tells_depth else None

    def right(self, index):
        """1.6 m to the right: disparity 16."""
        return self._crop(self.step * index + 16, self.step * index // 2) if self.tells_stereo else None

    def baseline(self):
        return 1.6 if self.tells_stereo else None

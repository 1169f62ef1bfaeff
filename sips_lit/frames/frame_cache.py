"""Sequences that remember what they read: the pairs of a benchmark share frames, and every detector sees them all."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from sips_lit.types import Camera, FloatArray, GreyImage, ImageSequence

LIMIT: Final = 1 << 30
"""Bytes that are remembered of a pair set."""


class FrameCache:
    """Arrays by key, the least recently used forgotten beyond ``limit`` bytes; for several threads."""

    def __init__(self, limit: int = LIMIT) -> None:
        self.limit, self.held = limit, 0
        self._arrays: OrderedDict[object, np.ndarray[Any, Any] | None] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: object, read: Callable[[], Any]) -> Any:
        """What is remembered, or what ``read`` gives (an array, or None where there is nothing)."""
        with self._lock:
            if key in self._arrays:
                self._arrays.move_to_end(key)
                return self._arrays[key]
        array = read()
        with self._lock:
            if key not in self._arrays:
                self._arrays[key] = array
                self.held += _size(array)
            while self.held > self.limit and self._arrays:
                self.held -= _size(self._arrays.popitem(last=False)[1])
        return array


class CachedSequence(ImageSequence):
    """Another sequence; its frames, depth maps and right images stay in ``memory`` once they were read."""

    def __init__(self, whole: ImageSequence, memory: FrameCache) -> None:
        self.whole, self.memory = whole, memory
        self.name, self.fingerprint, self.temporal = whole.name, whole.fingerprint, whole.temporal

    def __len__(self) -> int:
        return len(self.whole)

    def frame(self, index: int) -> GreyImage:
        """Frame ``index``; raises BadInputError when it cannot be read."""
        frame: GreyImage = self.memory.get((id(self.whole), "frame", index), lambda: self.whole.frame(index))
        return frame

    def frame_name(self, index: int) -> str:
        """What output files of the frame are called."""
        return self.whole.frame_name(index)

    def camera(self, index: int) -> Camera | None:
        """Intrinsics of the frame."""
        return self.whole.camera(index)

    def pose(self, index: int) -> FloatArray | None:
        """``T_world_camera`` of the frame."""
        return self.whole.pose(index)

    def depth(self, index: int) -> FloatArray | None:
        """Depth of the frame (H, W)."""
        depth: FloatArray | None = self.memory.get((id(self.whole), "depth", index), lambda: self.whole.depth(index))
        return depth

    def right(self, index: int) -> GreyImage | None:
        """The right image of the frame."""
        right: GreyImage | None = self.memory.get((id(self.whole), "right", index), lambda: self.whole.right(index))
        return right

    def baseline(self) -> float | None:
        """Metres between the cameras."""
        return self.whole.baseline()

    def time(self, index: int) -> float | None:
        """When the frame was taken."""
        return self.whole.time(index)

    def homography(self, index0: int, index1: int) -> FloatArray | None:
        """From pixels of one frame to those of another."""
        return self.whole.homography(index0, index1)


def _size(array: np.ndarray[Any, Any] | None) -> int:
    return 0 if array is None else array.nbytes

"""A cache of frames: the pairs of a benchmark share frames, and every detector sees them all."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from sips_lit.frames.views import SequenceView
from sips_lit.types import FloatArray, GreyImage, ImageSequence

LIMIT: Final = 1 << 30
"""Bytes that the cache of a pair set may hold."""


class FrameCache:
    """Arrays by key, for several threads; beyond ``limit`` bytes the least recently used are dropped."""

    def __init__(self, limit: int = LIMIT) -> None:
        self.limit, self.held = limit, 0
        self._arrays: OrderedDict[object, np.ndarray[Any, Any] | None] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: object, read: Callable[[], Any]) -> Any:
        """The cached array, else what ``read`` gives (an array, or None where there is nothing)."""
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


class CachedSequence(SequenceView):
    """Another sequence whose frames, depth maps and right images stay in ``cache`` once they were read."""

    def __init__(self, whole: ImageSequence, cache: FrameCache) -> None:
        super().__init__(whole)
        self.cache = cache

    def frame(self, index: int) -> GreyImage:
        """Frame ``index``; raises BadInputError when it cannot be read."""
        frame: GreyImage = self.cache.get((id(self.whole), "frame", index), lambda: self.whole.frame(index))
        return frame

    def depth(self, index: int) -> FloatArray | None:
        """Depth of the frame (H, W)."""
        depth: FloatArray | None = self.cache.get((id(self.whole), "depth", index), lambda: self.whole.depth(index))
        return depth

    def right(self, index: int) -> GreyImage | None:
        """The right image of the frame."""
        right: GreyImage | None = self.cache.get((id(self.whole), "right", index), lambda: self.whole.right(index))
        return right


def _size(array: np.ndarray[Any, Any] | None) -> int:
    return 0 if array is None else array.nbytes

"""What was read last stays at hand, as far as a number of bytes allows."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

V = TypeVar("V")


class Recent(Generic[V]):
    """Values by key, of one thread; beyond ``limit`` bytes, which ``size`` tells, the least recently used are dropped.

    The newest stays whatever its size.
    """

    def __init__(self, limit: int, size: Callable[[V], int]) -> None:
        self.limit, self.size, self.held = limit, size, 0
        self._values: OrderedDict[Hashable, V] = OrderedDict()

    def get(self, key: Hashable, read: Callable[[], V]) -> V:
        """The value that is held, else what ``read`` gives."""
        if key in self._values:
            self._values.move_to_end(key)
            return self._values[key]
        value = self._values[key] = read()
        self.held += self.size(value)
        while self.held > self.limit and len(self._values) > 1:
            self.held -= self.size(self._values.popitem(last=False)[1])
        return value

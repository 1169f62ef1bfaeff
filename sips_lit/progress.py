"""Progress of long steps: a bar on a terminal, a line now and then in a log."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import Any, Final, Generic, Never, Protocol, Self, TextIO, TypeVar, overload

from tqdm import tqdm

SECONDS: Final = 10.0
"""Between two lines of a log."""

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


class Progress(Protocol[T_co]):
    """Counts the items that are taken from it, and those that ``update`` reports; ``total`` may change meanwhile."""

    total: float | None

    def __iter__(self) -> Iterator[T_co]: ...

    def update(self, n: float = 1) -> object:
        """Counts ``n`` more."""
        ...

    def close(self) -> None:
        """Ends the display."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None: ...


@overload
def progress(
    iterable: Iterable[T], *, desc: str, unit: str, total: float | None = None, initial: int = 0, delay: float = 2
) -> Progress[T]: ...
@overload
def progress(
    iterable: None = None, *, desc: str, unit: str, total: float | None = None, initial: int = 0, delay: float = 2
) -> Progress[Never]: ...
def progress(
    iterable: Iterable[Any] | None = None,
    *,
    desc: str,
    unit: str,
    total: float | None = None,
    initial: int = 0,
    delay: float = 2,
) -> Progress[Any]:
    """Shows on standard error how much of ``iterable``, or of what ``update`` reports, is done.

    A bar on a terminal, else a line every ten seconds; nothing for work that ends within ``delay`` seconds. ``unit`` is
    one item, "frame", or "B" for bytes; ``initial`` of the ``total`` items were done before.
    """
    if not sys.stderr.isatty():
        return ProgressLines(iterable, desc, unit, total, initial, delay)
    return tqdm(
        iterable,
        desc=desc,
        total=total,
        initial=initial,
        unit=unit if unit == "B" else f" {unit}s",
        unit_scale=unit == "B",
        delay=delay,
        leave=False,
    )


class LineClock:
    """Says when a line of a log is due: first after ``delay`` seconds, then at most once in ``seconds``."""

    def __init__(self, delay: float, seconds: float = SECONDS, clock: Callable[[], float] = time.monotonic) -> None:
        self.seconds, self.clock = seconds, clock
        self.start = clock()
        self._next = self.start + delay

    def due(self) -> bool:
        """Whether to write a line now; True starts the wait for the next one."""
        now = self.clock()
        if now < self._next:
            return False
        self._next = now + self.seconds
        return True

    @property
    def elapsed(self) -> float:
        """Seconds since the start."""
        return self.clock() - self.start


class ProgressLines(Generic[T]):
    """The use of a tqdm bar, written as lines to ``stream`` (standard error); several threads may update it."""

    def __init__(
        self,
        iterable: Iterable[T] | None,
        desc: str,
        unit: str,
        total: float | None = None,
        initial: int = 0,
        delay: float = 2,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.iterable: Iterable[T] = () if iterable is None else iterable
        self.total = len(iterable) if total is None and hasattr(iterable, "__len__") else total  # type: ignore[arg-type]
        self.desc, self.unit, self.initial, self.done = desc, unit, initial, float(initial)
        self.stream = stream or sys.stderr
        self._clock, self._lock = LineClock(delay, clock=clock), threading.Lock()

    def __iter__(self) -> Iterator[T]:
        for item in self.iterable:
            yield item
            self.update()

    def update(self, n: float = 1) -> None:
        """Counts ``n`` more, and writes a line if one is due."""
        with self._lock:
            self.done += n
            if self._clock.due():
                print(self._line(), file=self.stream, flush=True)

    def close(self) -> None:
        """Nothing is left to write."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _line(self) -> str:
        digits, scale, units = (1, 1e6, "MB") if self.unit == "B" else (0, 1, f"{self.unit}s")
        done = f"{self.done / scale:.{digits}f}"
        if not self.total or self.done > self.total:  # a video may have more frames than it says
            return f"{self.desc}: {done} {units}, {duration(self._clock.elapsed)}"
        left = time_left(self.done - self.initial, self.total - self.done, self._clock.elapsed)
        total, percent = f"{self.total / scale:.{digits}f}", f"{100 * self.done / self.total:.0f} %"
        return f"{self.desc}: {done}/{total} {units} ({percent}), {left}"


def time_left(done: float, rest: float, elapsed: float) -> str:
    """How long the ``rest`` takes at the pace of what was ``done`` in ``elapsed`` seconds."""
    return f"{duration(rest * elapsed / done)} left" if done > 0 else "time left unknown"


def duration(seconds: float) -> str:
    """Seconds up to ten minutes, minutes up to three hours, then hours."""
    if seconds < 600:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 3 * 3600 else f"{seconds / 3600:.1f} h"

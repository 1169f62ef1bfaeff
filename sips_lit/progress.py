"""Progress of long steps: a bar on a terminal, a line now and then in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable
from typing import Any, Final, Never, TypeVar, overload

from tqdm import tqdm

SECONDS: Final = 10.0
"""Between two lines of a log."""

T = TypeVar("T")


@overload
def progress(
    iterable: Iterable[T], *, desc: str, unit: str, total: float | None = None, initial: int = 0, delay: float = 2
) -> tqdm[T]: ...
@overload
def progress(
    *, desc: str, unit: str, total: float | None = None, initial: int = 0, delay: float = 2
) -> tqdm[Never]: ...
def progress(
    iterable: Iterable[Any] | None = None, *, desc: str, unit: str, delay: float = 2, **options: Any
) -> tqdm[Any]:
    """Shows on standard error how much of ``iterable``, or of what ``update`` reports, is done.

    A bar on a terminal, else a line every ten seconds; nothing for work that ends within ``delay`` seconds. ``unit`` is
    one item, "frame", or "B" for bytes; ``initial`` of the ``total`` items were done before.
    """
    kind: type[tqdm[Any]] = tqdm if sys.stderr.isatty() else ProgressLines
    units, scale = (unit, True) if unit == "B" else (f" {unit}s", False)
    return kind(iterable, desc=desc, unit=units, unit_scale=scale, delay=delay, leave=False, **options)


class ProgressLines(tqdm):  # type: ignore[type-arg]
    """A tqdm bar as lines: the first after ``delay`` seconds, then one every ``seconds``; several threads may update it."""

    monitor_interval = 0  # no thread that watches: a process that forks should have none

    def __init__(
        self,
        iterable: Any = None,
        *,
        delay: float = 2,
        seconds: float = SECONDS,
        clock: Callable[[], float] = time.monotonic,
        **options: Any,
    ) -> None:
        super().__init__(iterable, mininterval=0, miniters=0, gui=True, **options)  # gui: the display is not tqdm's
        self.seconds, self._time = seconds, clock
        self.start_t = self.last_print_t = clock()
        self.due = self.start_t + delay

    def update(self, n: float | None = 1) -> bool | None:
        """Counts ``n`` more, and writes a line if one is due."""
        with self.get_lock():  # type: ignore[no-untyped-call]
            return super().update(n)

    def clear(self, *_: Any, **__: Any) -> None:
        """Nothing: lines stay, whatever else is written."""

    def display(self, *_: Any) -> None:
        """Writes a line if one is due."""
        now = self._time()
        if now >= self.due:
            self.due = now + self.seconds
            print(self.line(now - self.start_t), file=self.fp, flush=True)

    def line(self, elapsed: float) -> str:
        """What is done after ``elapsed`` seconds, and how long the rest takes."""
        scale, digits, units = (1e6, 1, " MB") if self.unit_scale else (1, 0, self.unit)
        done = f"{self.n / scale:.{digits}f}"
        if not self.total or self.n > self.total:  # a video may have more frames than it says
            return f"{self.desc}: {done}{units}, {duration(elapsed)}"
        total, percent = f"{self.total / scale:.{digits}f}", f"{100 * self.n / self.total:.0f} %"
        left = time_left(self.n - self.initial, self.total - self.n, elapsed)
        return f"{self.desc}: {done}/{total}{units} ({percent}), {left}"


def time_left(done: float, rest: float, elapsed: float) -> str:
    """How long the ``rest`` takes at the pace of what was ``done`` in ``elapsed`` seconds."""
    return f"{duration(rest * elapsed / done)} left" if done > 0 else "time left unknown"


def duration(seconds: float) -> str:
    """Seconds up to ten minutes, minutes up to three hours, then hours."""
    if seconds < 600:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 3 * 3600 else f"{seconds / 3600:.1f} h"

"""Which of several ways to do the same takes the least time on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Final, TypeVar

ROUNDS: Final = 3
"""Turns of each that count."""

Way = TypeVar("Way")


def least_seconds(
    ways: Mapping[Way, Callable[[], object]], clock: Callable[[], float] = time.perf_counter
) -> dict[Way, float]:
    """Seconds that each way takes, the least of `ROUNDS` turns, which other work on the machine disturbs least.

    All take turns, so that what else the machine does meets them alike; a first turn, in which memory is taken and models
    are compiled, does not count.
    """
    taken: dict[Way, list[float]] = {way: [] for way in ways}
    for _ in range(ROUNDS + 1):
        for way, run in ways.items():
            start = clock()
            run()
            taken[way].append(clock() - start)
    return {way: min(times[1:]) for way, times in taken.items()}

"""How long the steps of a detection take: recorded where somebody asks, so that what is timed is what runs."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final

import torch

_RECORD: Final[ContextVar[dict[str, float] | None]] = ContextVar("steps", default=None)


@contextmanager
def step(name: str) -> Iterator[None]:
    """Adds the milliseconds of a block to the record, if there is one."""
    record = _RECORD.get()
    if record is None:
        yield
        return
    start = now()
    yield
    record[name] = record.get(name, 0.0) + now() - start


@contextmanager
def recorded_steps() -> Iterator[dict[str, float]]:
    """The milliseconds of each step of what is called within, filled as it goes."""
    record: dict[str, float] = {}
    token = _RECORD.set(record)
    try:
        yield record
    finally:
        _RECORD.reset(token)


def now() -> float:
    """Milliseconds of a clock, once a GPU that is in use has done its work."""
    if torch.cuda.is_initialized():  # type: ignore[no-untyped-call]
        torch.cuda.synchronize()
    return 1e3 * time.perf_counter()

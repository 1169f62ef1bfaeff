"""Where the time of training steps goes, in TensorBoard and in a line at the end."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

import lightning as L
from torch import Tensor

from sips_lit.train.loader import LabelledPair
from sips_lit.train.step_times import Stopwatch, in_words

WARM_UP = 2
"""Steps that don't count: workers start, and nothing is ahead."""


class StepTimes(L.Callback):
    """Logs milliseconds of each stage of a pair, and has their means in ``told``; ``clock`` gives seconds.

    A pair brings the times of its own decoding and labelling. Nothing waits for a GPU: its time appears where the processor
    waits for it.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self.clock, self.pairs = clock, 0
        self.total, self._pair = Stopwatch(), Stopwatch()
        self._mark: float | None = None

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Starts from no pairs, also after a run before."""
        self.pairs, self.total, self._mark = -WARM_UP, Stopwatch(), None

    def on_train_batch_start(
        self, trainer: L.Trainer, pl_module: L.LightningModule, batch: Any, batch_idx: int
    ) -> None:
        """Takes what the pair brings; of other batches it is only known how long they were waited for."""
        now, self._pair = self.clock(), Stopwatch()
        waited = {} if self._mark is None else {"wait_decode": now - self._mark}
        for stage, seconds in (batch.seconds if isinstance(batch, LabelledPair) else waited).items():
            self._pair.add(stage, seconds)
        self._mark = now

    def on_before_backward(self, trainer: L.Trainer, pl_module: L.LightningModule, loss: Tensor) -> None:
        """The forward pass ends."""
        self._lap("forward")

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """The pair ends: logs it, and counts it after the first ones."""
        self._lap("backward")
        times = {f"time/{stage}": 1000 * seconds for stage, seconds in self._pair.seconds.items()}
        pl_module.log_dict(times, batch_size=1)
        self.pairs += 1
        if self.pairs > 0:
            for stage, seconds in self._pair.seconds.items():
                self.total.add(stage, seconds)

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """A validation is not waiting."""
        self._mark = None

    def _lap(self, stage: str) -> None:
        now = self.clock()
        if self._mark is not None:
            self._pair.add(stage, now - self._mark)
        self._mark = now

    def told(self, loading_workers: int, labelling_workers: int) -> str | None:
        """Shares of a step, and advice; None if no pair counted."""
        if self.pairs <= 0:
            return None
        means = {stage: seconds / self.pairs for stage, seconds in self.total.seconds.items()}
        return in_words(means, loading_workers, labelling_workers, cores())


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

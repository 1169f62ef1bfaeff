"""Progress of training: a bar on a terminal, lines in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any, Never

import lightning as L
from lightning.pytorch.callbacks import ProgressBar, TQDMProgressBar
from lightning.pytorch.callbacks.progress.tqdm_progress import Tqdm

from sips_lit.progress import SECONDS, LineClock, ProgressLines, time_left


def training_progress(seconds: float = SECONDS) -> ProgressBar:
    """A bar if standard error is a terminal, else lines, one every ``seconds``.

    A choice of our own, since the trainer's depends on whether the package rich happens to be installed.
    """
    return TrainingBar() if sys.stderr.isatty() else TrainingLines(seconds)


class TrainingBar(TQDMProgressBar):
    """Lightning's bar for a run that is counted in steps: without epochs, and with totals from the start."""

    def init_train_tqdm(self) -> Tqdm:
        """The bar of training steps; a resumed run goes on from its step, at its own pace."""
        return self._bar("training", "step", self.trainer.max_steps, initial=self.trainer.global_step)

    def init_validation_tqdm(self) -> Tqdm:
        """The bar of the pairs of one validation."""
        return self._bar("validation", "pair", _validation_pairs(self.trainer), position=1)

    def init_sanity_tqdm(self) -> Tqdm:
        """The bar of the validation before a run, where one is asked for."""
        return self._bar("sanity check", "pair", self.trainer.num_sanity_val_steps)  # its data is not loaded yet

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Counts by the trainer's step: ``batch_idx`` counts pairs, and begins anew in some resumed runs."""
        self.train_progress_bar.n = trainer.global_step
        self.train_progress_bar.set_postfix(self.get_metrics(trainer, pl_module))

    def on_train_epoch_start(self, trainer: L.Trainer, *_: Any) -> None:
        """Nothing: a run has no epochs."""

    def on_validation_batch_start(self, *_: Any, **__: Any) -> None:
        """Nothing: the bar knows its total."""

    def on_exception(self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException) -> None:
        """Frees the line of the terminal for the message that follows."""
        for bar in (self._val_progress_bar, self._train_progress_bar):
            if bar is not None:
                bar.close()

    def get_metrics(self, trainer: L.Trainer, pl_module: L.LightningModule) -> dict[str, Any]:
        """What modules and callbacks log for the bar."""
        return _metrics(trainer)

    def _bar(self, desc: str, unit: str, total: float, position: int = 0, initial: int = 0) -> Tqdm:
        return Tqdm(
            desc=desc, total=total, unit=f" {unit}s", initial=initial, position=position, disable=self.is_disabled,
            leave=False, dynamic_ncols=True, smoothing=0, file=sys.stderr, bar_format=self.BAR_FORMAT,
        )  # fmt: skip


class TrainingLines(ProgressBar):
    """Lines on standard error: the first after the first step, then one every ``seconds``.

    Steps and the time that is left are counted at the pace of this run so far, validations included.
    """

    def __init__(self, seconds: float = SECONDS, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self.seconds, self.clock, self.enabled = seconds, clock, True

    def enable(self) -> None:
        """Writes lines."""
        self.enabled = True

    def disable(self) -> None:
        """Writes none, as all processes of a run but the first."""
        self.enabled = False

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Starts the clock."""
        self._lines, self._first_step = LineClock(0, self.seconds, self.clock), trainer.global_step

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Writes a line if one is due."""
        if self.enabled and self._lines.due():
            print(self._line(trainer), file=sys.stderr, flush=True)

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Counts validation pairs."""
        self._validation = ProgressLines[Never](
            None, "validation", "pair", _validation_pairs(trainer), clock=self.clock
        )

    def on_validation_batch_end(self, *_: Any, **__: Any) -> None:
        """Writes a line if one is due."""
        if self.enabled:
            self._validation.update()

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Ends the count."""
        self._validation.close()

    def _line(self, trainer: L.Trainer) -> str:
        done, elapsed = trainer.global_step - self._first_step, self._lines.elapsed
        metrics = [f"{name} {value:.2f}" for name, value in _metrics(trainer).items()]
        pace = [f"{done / elapsed:.2g} steps/s"] if done and elapsed else []
        left = time_left(done, trainer.max_steps - trainer.global_step, elapsed)
        return ", ".join([f"step {trainer.global_step}/{trainer.max_steps}", *metrics, *pace, left])


def _metrics(trainer: L.Trainer) -> dict[str, float]:
    return {name.removeprefix("train/"): float(value) for name, value in trainer.progress_bar_metrics.items()}


def _validation_pairs(trainer: L.Trainer) -> float:
    return sum(trainer.num_sanity_val_batches if trainer.sanity_checking else trainer.num_val_batches)

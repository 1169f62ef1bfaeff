"""Progress of training: a bar on a terminal, lines in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import lightning as L
from lightning.pytorch.callbacks import ProgressBar, TQDMProgressBar
from lightning.pytorch.callbacks.progress.tqdm_progress import Tqdm

from sips_lit.progress import SECONDS, ProgressLines, time_left


def training_progress(seconds: float = SECONDS) -> ProgressBar:
    """A bar if standard error is a terminal, else lines, one every ``seconds``.

    A choice of our own, since the trainer's depends on whether the package rich happens to be installed.
    """
    return TrainingBar() if sys.stderr.isatty() else TrainingLines(seconds)


class TrainingBar(TQDMProgressBar):
    """Lightning's bar for a run that is counted in steps: without epochs, and with totals from the start."""

    before_a_run = "sanity check"

    def init_train_tqdm(self) -> Any:
        """The bar of training steps; a resumed run goes on from its step, at its own pace."""
        return self._bar(desc="training", unit=" steps", total=self.trainer.max_steps, initial=self.trainer.global_step)

    def init_sanity_tqdm(self) -> Tqdm:
        """Nothing yet: the pairs of a validation before a run are counted when it starts."""
        return Tqdm(disable=True)

    def init_validation_tqdm(self) -> Any:
        """The bar of the pairs of one validation."""
        if self.trainer.sanity_checking:
            return self._bar(desc=self.before_a_run, unit=" pairs", total=sum(self.trainer.num_sanity_val_batches))
        return self._bar(desc="validation", unit=" pairs", total=sum(self.trainer.num_val_batches), position=1)

    def on_validation_start(self, *_: Any) -> None:
        """Shows the bar, before a run too."""
        self.val_progress_bar = self.init_validation_tqdm()

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Counts by the trainer's step: ``batch_idx`` counts pairs, and begins anew in some resumed runs."""
        if self.is_enabled:
            self.train_progress_bar.n = trainer.global_step
            self.train_progress_bar.set_postfix(self.get_metrics(trainer, pl_module), refresh=False)
            self.train_progress_bar.refresh()

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
        return {name.removeprefix("train/"): float(value) for name, value in trainer.progress_bar_metrics.items()}

    def _bar(self, **options: Any) -> Any:
        return Tqdm(
            **options, disable=self.is_disabled, leave=False, dynamic_ncols=True, smoothing=0, file=sys.stderr,
            bar_format=self.BAR_FORMAT,
        )  # fmt: skip


class TrainingLines(TrainingBar):
    """The same as lines on standard error: the first after the first step, then one every ``seconds``."""

    before_a_run = "validation"

    def __init__(self, seconds: float = SECONDS, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self.seconds, self.clock = seconds, clock

    def init_train_tqdm(self) -> Any:
        """The lines of training steps."""
        steps, done = self.trainer.max_steps, self.trainer.global_step
        return _StepLines(total=steps, initial=done, delay=0, seconds=self.seconds, clock=self.clock)

    def _bar(self, **options: Any) -> Any:
        return ProgressLines(**options, clock=self.clock)


class _StepLines(ProgressLines):
    """Lines with the pace, and with metrics, which alone do not make a line due."""

    metrics: Mapping[str, float] = MappingProxyType({})

    def set_postfix(self, ordered_dict: Any = None, *_: Any, **__: Any) -> None:
        self.metrics = ordered_dict

    def line(self, elapsed: float) -> str:
        done, total = self.n - self.initial, self.total or 0
        metrics = [f"{name} {value:.2f}" for name, value in self.metrics.items()]
        pace = [f"{done / elapsed:.2g} steps/s"] if done and elapsed else []
        return ", ".join([f"step {self.n}/{total}", *metrics, *pace, time_left(done, total - self.n, elapsed)])

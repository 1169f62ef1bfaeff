"""What keeps a run safe: a stop at the first non-finite loss, a checkpoint on Ctrl-C, and one after the last step."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import subprocess
import threading
from pathlib import Path
from types import FrameType
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Checkpoint
from torch import Tensor

from sips_lit.callbacks.slurm import in_job, requeue
from sips_lit.errors import BadInputError, TrainingInterrupted
from sips_lit.files import make_folder, write_whole

SECONDS_TO_END = 10  # of a process that has stopped together with the first one
WARNINGS = tuple(getattr(signal, name) for name in ("SIGUSR1", "SIGUSR2") if hasattr(signal, name))  # of schedulers


class NonFiniteGuard(L.Callback):
    """Stops before a loss that is NaN or infinite can spoil the weights, and saves the batch that caused it.

    ``folder``: where the batch goes, as plain tensors in ``nonfinite_batch.pt``.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.batch: Any = None

    def on_train_batch_start(
        self, trainer: L.Trainer, pl_module: L.LightningModule, batch: Any, batch_idx: int
    ) -> None:
        """Notes the batch."""
        self.batch = batch

    def on_before_backward(self, trainer: L.Trainer, pl_module: L.LightningModule, loss: Tensor) -> None:
        """Raises BadInputError when the loss is not finite."""
        if torch.isfinite(loss):
            return
        make_folder(self.folder)
        path, content = self.folder / "nonfinite_batch.pt", io.BytesIO()
        torch.save({} if self.batch is None else self.batch.plain(), content)
        write_whole(path, content.getbuffer())
        raise BadInputError(
            f"the loss became {float(loss.detach())} at step {trainer.global_step}: the batch is saved as {path}; lower "
            "optim.optimizer.lr, or train with trainer.precision=32-true; checkpoints up to the last validation are intact"
        )


class GracefulStop(Checkpoint):
    """On Ctrl-C or SIGTERM finishes the step, saves ``checkpoint`` and raises TrainingInterrupted.

    A validation that runs or is due comes first: a resumed run would leave it out. Of several processes any may get the
    signal: all stop at the same step. Ctrl-C after that stops at once and saves nothing; another SIGTERM is no haste, as
    schedulers send it twice. Being a Checkpoint, this comes after the callbacks that measure and save a validation.

    A scheduler warns of a preemption or of the time limit by SIGUSR1 or SIGUSR2: the run stops in the same way, then who
    listened to that signal before is called, such as submitit, which has the job started again. In a job of Slurm
    to whose SIGUSR1 nobody listens Slurm is asked for that here.
    """

    def __init__(self, checkpoint: str | Path) -> None:
        self.checkpoint = Path(checkpoint)
        self.requested = 0  # the number of the signal
        self._previous: dict[int, Any] = {}

    def on_fit_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Listens in place of Lightning, which stops within a validation and hangs if one process alone is told."""
        self.requested = 0
        trainer._signal_connector._sigterm_notifier_fn = lambda *_: None  # type: ignore[method-assign]  # Lightning has no switch
        if threading.current_thread() is threading.main_thread():
            warned = [number for number in WARNINGS if callable(signal.getsignal(number))]
            if in_job() and signal.SIGUSR1 not in warned:  # Lightning would save in the middle of a step
                warned.append(signal.SIGUSR1)
            for number in (signal.SIGINT, signal.SIGTERM, *warned):
                self._previous[number] = signal.signal(number, self._on_signal)

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Saves and stops if it was asked to, and if the run can go on from here."""
        count = batch_idx + 1
        inside_step = count % trainer.accumulate_grad_batches != 0
        validates = trainer.should_stop or count % (trainer.val_check_batch or count + 1) == 0
        if not inside_step and not validates:
            self._stop_if_asked(trainer)

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Saves and stops if it was asked to; a sanity check has nothing to save yet."""
        if not trainer.sanity_checking:
            self._stop_if_asked(trainer)

    def _stop_if_asked(self, trainer: L.Trainer) -> None:
        number = self.requested
        if trainer.world_size > 1:
            asked = torch.tensor(number, device=trainer.strategy.root_device)
            number = int(trainer.strategy.reduce(asked, reduce_op="max"))
        if number:
            trainer.save_checkpoint(self.checkpoint)
            again = self._ask_for_another_start(trainer, number) if number in WARNINGS else ""
            if not trainer.is_global_zero:
                raise SystemExit(0)  # the first process tells; where Lightning launched them, another code kills it
            raise TrainingInterrupted(
                f"stopped at step {trainer.global_step} and saved {self.checkpoint}{again}", number
            )

    def _ask_for_another_start(self, trainer: L.Trainer, number: int) -> str:
        """What comes of it; who listened before may end the process."""
        # not given back: the scheduler sends it next, which must not disturb
        self._previous.pop(signal.SIGTERM, None)
        listener = self._previous.get(number)
        if callable(listener):
            listener(number, None)
            return ""
        return f"; {requeue()}" if trainer.is_global_zero else ""

    def teardown(self, trainer: L.Trainer, pl_module: L.LightningModule, stage: str) -> None:
        """Gives the signals back, and passes on one that came after the last validation."""
        self._give_back()
        if self.requested and signal.getsignal(self.requested) is not signal.SIG_DFL:
            signal.raise_signal(self.requested)

    def on_exception(self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException) -> None:
        """Gives the signals back, as there is no teardown after an exception; ends the processes that Lightning launched.

        After a stop it listens on: another SIGTERM must not end the cleaning up.
        """
        if not isinstance(exception, TrainingInterrupted):
            self._give_back()
        processes = getattr(trainer.strategy.launcher, "procs", [])
        for process in processes:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(SECONDS_TO_END if isinstance(exception, TrainingInterrupted) else 0)
            process.kill()  # it may wait for this one
        processes.clear()  # Lightning's observer of them would kill this one

    def _give_back(self) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)
        self._previous.clear()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self.requested and number == signal.SIGINT:
            raise KeyboardInterrupt
        if not self.requested:
            self.requested = number
            with contextlib.suppress(OSError):  # not by print, which the signal may have interrupted
                os.write(1, b"\nstopping after this step or validation (Ctrl-C: at once, without a checkpoint)\n")


class LastValidation(L.Callback):
    """Validates, and so saves, after the last step wherever ``val_check_interval`` falls.

    Otherwise the steps after the last regular validation would be in no checkpoint.
    """

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Ends the fit after the last step, which makes the trainer validate."""
        if trainer.global_step >= trainer.max_steps:
            trainer.should_stop = True

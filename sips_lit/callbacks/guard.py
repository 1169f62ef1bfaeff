"""What keeps a run safe: a stop at the first non-finite loss, a checkpoint on Ctrl-C, and one after the last step."""

from __future__ import annotations

import io
import signal
import threading
from dataclasses import asdict
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import lightning as L
import torch
from torch import Tensor

from sips_lit.errors import BadInputError, TrainingInterrupted
from sips_lit.files import make_folder, write_whole
from sips_lit.train.loader import LabelledPair


class NonFiniteGuard(L.Callback):
    """Stops before a loss that is NaN or infinite can spoil the weights, and saves the batch that caused it.

    ``folder``: where the batch goes, as plain tensors in ``nonfinite_batch.pt``.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.batch: LabelledPair | None = None

    def on_train_batch_start(
        self, trainer: L.Trainer, pl_module: L.LightningModule, batch: Any, batch_idx: int
    ) -> None:
        """Notes the batch."""
        self.batch = batch

    def on_before_backward(self, trainer: L.Trainer, pl_module: L.LightningModule, loss: Tensor) -> None:
        """Raises BadInputError when the loss is not finite."""
        if torch.isfinite(loss):
            return
        path, content = self.folder / "nonfinite_batch.pt", io.BytesIO()
        torch.save(_plain(self.batch), content)
        make_folder(self.folder)
        write_whole(path, content.getvalue())
        raise BadInputError(
            f"the loss became {float(loss.detach())} at step {trainer.global_step}: the batch is saved as {path}; lower "
            "optim.optimizer.lr, or train with trainer.precision=32-true; checkpoints up to the last validation are intact"
        )


class GracefulStop(L.Callback):
    """On Ctrl-C (or SIGTERM) finishes the step, saves ``checkpoint`` and raises TrainingInterrupted.

    During a validation, or right before one, it waits for its end. A second Ctrl-C stops at once and saves nothing.
    """

    def __init__(self, checkpoint: str | Path) -> None:
        self.checkpoint = Path(checkpoint)
        self.requested = False
        self._saved = False
        self._previous: dict[int, Any] = {}

    def on_fit_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Listens."""
        self.requested = self._saved = False
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._previous[number] = signal.signal(number, self._on_signal)

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Saves and stops if it was asked to, and if the run can go on from here.

        Not while gradients are accumulated, nor when a validation follows: a resumed run would leave it out.
        """
        count = batch_idx + 1
        inside_step = count % trainer.accumulate_grad_batches != 0
        validates = trainer.should_stop or count % (trainer.val_check_batch or count + 1) == 0
        if self.requested and not inside_step and not validates:
            self._save(trainer)
            self._stop(trainer)

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Saves if it was asked to stop; callbacks that come later still see the validation."""
        if self.requested:
            self._save(trainer)

    def on_train_batch_start(
        self, trainer: L.Trainer, pl_module: L.LightningModule, batch: Any, batch_idx: int
    ) -> None:
        """Stops if a validation came in between."""
        if self._saved:
            self._stop(trainer)

    def _save(self, trainer: L.Trainer) -> None:
        trainer.save_checkpoint(self.checkpoint)
        self._saved = True

    def _stop(self, trainer: L.Trainer) -> NoReturn:
        raise TrainingInterrupted(f"stopped at step {trainer.global_step} and saved {self.checkpoint}")

    def teardown(self, *_: Any, **__: Any) -> None:
        """Gives the signals back."""
        for number, handler in self._previous.items():
            signal.signal(number, handler)
        self._previous.clear()

    on_exception = teardown  # there is no teardown after an exception

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True
        print("\nstopping after this step (again: at once, without a checkpoint)", flush=True)


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


def _plain(batch: LabelledPair | None) -> dict[str, Any]:
    """A batch as tensors, numbers and strings, which load without running code."""
    if batch is None:
        return {}
    plain: dict[str, Any] = {"name": batch.name, "image0": batch.image0.cpu(), "image1": batch.image1.cpu()}
    for side, points, labels in (("0", batch.points0, batch.labels0), ("1", batch.points1, batch.labels1)):
        arrays = {**asdict(points.keypoints), "row": points.row, "column": points.column, **asdict(labels)}
        for name, array in arrays.items():
            if array is not None:
                plain[f"{name}{side}"] = torch.from_numpy(array.copy())
    return plain

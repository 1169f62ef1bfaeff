"""A validation after the last step of a run."""

from __future__ import annotations

from typing import Any

import lightning as L


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

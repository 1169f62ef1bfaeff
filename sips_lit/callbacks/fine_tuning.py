"""How much better a network became than the weights that it started from."""

from __future__ import annotations

from typing import Any

import lightning as L


class FineTuning(L.Callback):
    """Validates before the first step, and keeps the AUC of the start with the run's checkpoints.

    A run that goes on has it from its checkpoint.
    """

    def __init__(self) -> None:
        self.start: float | None = None

    def setup(self, trainer: L.Trainer, pl_module: L.LightningModule, stage: str) -> None:
        """Makes the sanity check, which a run that goes on leaves out, a whole validation."""
        trainer.num_sanity_val_steps = float("inf")

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Notes the AUC of the start."""
        if trainer.sanity_checking:
            self.start = float(trainer.callback_metrics["val/succinctness_auc"])

    def state_dict(self) -> dict[str, Any]:
        """The AUC of the start."""
        return {"start": self.start}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Takes it over."""
        self.start = state_dict["start"]

    def told(self, auc: float, init: str) -> str:
        """In words, for the best AUC of the run: both are of the same held-back pairs."""
        assert self.start is not None
        if auc > self.start:
            return f"AUC {self.start:.3f} with the weights of {init}, {auc:.3f} now ({auc - self.start:+.3f})"
        return (
            f"no gain: AUC {self.start:.3f} with the weights of {init}, {auc:.3f} at best after it: keep them, or give more "
            "data, more steps or a lower optim.optimizer.lr"
        )

"""The numbers of the best validation of a run, which compare runs in TensorBoard's table."""

from __future__ import annotations

from typing import Any, Final

import lightning as L

JUDGED_BY: Final[str] = "val/succinctness_auc"
KEPT: Final[tuple[str, ...]] = (JUDGED_BY, "val/n_at_80", "val/ece")


class BestValidation(L.Callback):
    """Logs ``best/...`` of the validation with the highest AUC so far: its AUC, points at 80 % success, and ECE.

    All are of that one validation, so a number that it has not (80 % never reached) is left out. A run that goes on has
    them from its checkpoint.
    """

    def __init__(self) -> None:
        self.best: dict[str, float] = {}

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Logs what the run had before it was interrupted: its folder may be another one now."""
        self._log(trainer)

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Forgets the validation before: Lightning keeps a number until there is another."""
        for name in KEPT:
            trainer.callback_metrics.pop(name, None)

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Logs the validation if it is the best."""
        now = {name: float(trainer.callback_metrics[name]) for name in KEPT if name in trainer.callback_metrics}
        if now.get(JUDGED_BY, float("-inf")) > self.best.get(JUDGED_BY, float("-inf")):
            self.best = now
            self._log(trainer)

    def _log(self, trainer: L.Trainer) -> None:
        values = {f"best/{name.removeprefix('val/')}": value for name, value in self.best.items()}
        for logger in trainer.loggers if values else ():
            logger.log_metrics(values, trainer.global_step)

    def state_dict(self) -> dict[str, Any]:
        """The numbers so far."""
        return {"best": self.best}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Takes them over."""
        self.best = state_dict["best"]

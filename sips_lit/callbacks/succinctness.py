"""Validation by succinctness: how many points give k inliers (paper, section on succinctness)."""

from __future__ import annotations

from typing import Any

import lightning as L
import torch

from sips_lit.callbacks.tensorboard import show
from sips_lit.inliers.verification import VerifiedPair
from sips_lit.metrics.succinctness import Succinctness
from sips_lit.render.curves import draw_succinctness


class SuccinctnessValidation(L.Callback):
    """Logs AUC, points at 80 % success, median and failures of the validation pairs, and the curve as a figure.

    ``k`` inliers within at most ``n_max`` points. The AUC, ``val/succinctness_auc``, chooses the best checkpoint.
    """

    def __init__(self, k: int = 10, n_max: int = 200) -> None:
        self.k, self.n_max = k, n_max
        self.metric = Succinctness(k, n_max)

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Starts from no pairs."""
        self.metric = self.metric.to(pl_module.device)
        self.metric.reset()

    def on_validation_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, *_: Any, **__: Any
    ) -> None:
        """Adds a pair."""
        if outputs is None:
            return
        assert isinstance(outputs, VerifiedPair)
        self.metric.update(outputs.points_needed(self.k, self.n_max))

    def on_validation_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Logs the summary; a number that does not exist (80 % never reached) is left out."""
        result = self.metric.result()
        scalars = {
            "val/succinctness_auc": result.auc,
            "val/failure_rate": result.failure_rate,
            "val/n_at_80": result.n_at_80,
            "val/n_median": result.median,
        }
        present = {name: torch.tensor(float(value)) for name, value in scalars.items() if value is not None}
        pl_module.log_dict(present, rank_zero_only=True)
        pl_module.log("auc", result.auc, prog_bar=True, logger=False, rank_zero_only=True)
        show(trainer, "val/curve", draw_succinctness("SIPs", result))

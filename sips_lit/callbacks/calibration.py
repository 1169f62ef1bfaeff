"""Validation by calibration: does a predicted probability come true (paper, experiment 4)."""

from __future__ import annotations

from typing import Any

import lightning as L
import torch

from sips_lit.callbacks.tensorboard import show
from sips_lit.inliers.verification import VerifiedPair
from sips_lit.metrics.calibration import Calibration
from sips_lit.render.reliability import draw_reliability


class CalibrationValidation(L.Callback):
    """Logs ECE, MCE and Brier score of the points' probabilities, and the reliability diagram as a figure.

    All points that the module selects in the validation pairs count, as in training; those of unknown truth don't.
    """

    def __init__(self, bins: int = 20) -> None:
        self.metric = Calibration(bins)

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Starts from no points."""
        self.metric = self.metric.to(pl_module.device)
        self.metric.reset()

    def on_validation_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, *_: Any, **__: Any
    ) -> None:
        """Adds the points of both images of a pair."""
        if outputs is None:
            return
        assert isinstance(outputs, VerifiedPair)
        scores, inlier = outputs.outcomes(max(len(outputs.features0), len(outputs.features1)))
        self.metric.update(torch.from_numpy(scores), torch.from_numpy(inlier))

    def on_validation_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Logs the summary."""
        result = self.metric.result()
        scalars = {"val/ece": result.ece, "val/mce": result.mce, "val/brier": result.brier}
        pl_module.log_dict({name: torch.tensor(value) for name, value in scalars.items()}, rank_zero_only=True)
        show(trainer, "val/reliability", draw_reliability(result))

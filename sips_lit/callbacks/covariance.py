"""Validation of covariances: are the residuals of the matches as large as the network says?"""

from __future__ import annotations

from typing import Any

import lightning as L
import torch

from sips_lit.callbacks.tensorboard import show
from sips_lit.inliers.verification import VerifiedPair
from sips_lit.metrics.covariance import CovarianceCalibration
from sips_lit.render.covariance import draw_covariance_reliability


class CovarianceValidation(L.Callback):
    """Logs the calibration error, needed factor and likelihood of covariances, and their reliability as a figure.

    Both directions of all inlier matches of the validation pairs count, where their residuals are measured.
    """

    def __init__(self, bins: int = 20) -> None:
        self.metric = CovarianceCalibration(bins)

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Starts from no residuals."""
        self.metric = self.metric.to(pl_module.device)
        self.metric.reset()

    def on_validation_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, *_: Any, **__: Any
    ) -> None:
        """Adds the residuals of a pair."""
        if outputs is None:
            return
        assert isinstance(outputs, VerifiedPair)
        found = outputs.residuals(max(len(outputs.features0), len(outputs.features1)))
        if found is not None:
            self.metric.update(*found)

    def on_validation_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Logs the summary."""
        result = self.metric.result()
        scalars = {"error": result.error, "scale": result.scale, "nll": result.nll}
        named = {f"val/covariance_{name}": torch.tensor(value) for name, value in scalars.items()}
        pl_module.log_dict(named, rank_zero_only=True)
        show(trainer, "val/covariance", draw_covariance_reliability({"validation": result}))

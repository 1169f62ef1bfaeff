"""The TensorBoard writer of a trainer, if it has one."""

from __future__ import annotations

import lightning as L
from lightning.pytorch.loggers import TensorBoardLogger
from torch.utils.tensorboard import SummaryWriter


def writer_of(trainer: L.Trainer) -> SummaryWriter | None:
    """Where figures and pictures of this run go; None without a TensorBoard logger and on processes but the first."""
    loggers = trainer.loggers if trainer.is_global_zero else []
    return next((logger.experiment for logger in loggers if isinstance(logger, TensorBoardLogger)), None)

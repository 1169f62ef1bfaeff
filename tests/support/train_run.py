from functools import partial

import lightning as L
import torch
from textured_scenes import flight

from sips_lit.describe.sift import RootSift
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.inliers.klt import KltInliers
from sips_lit.inliers.verification import VerifiedPair
from sips_lit.train.datamodule import PairDataModule
from sips_lit.train.module import SipsModule


def make_module(**options) -> SipsModule:
    torch.manual_seed(0)
    optimizer = partial(torch.optim.Adam, lr=1e-2)
    options = {"network": ScoreNetwork(3, 4), "optimizer": optimizer, "points": 40, **options}
    return SipsModule(selector=PointSelector(3), **options)


def make_data(tmp_path, sequence=None, **options) -> PairDataModule:
    options = {"val_fraction": 0.4, "val_pairs": 2, "loading_workers": 0, "labelling_workers": 1, **options}
    return PairDataModule(
        [sequence or flight(12, size=(96, 80))], RootSift(), KltInliers(), tmp_path / "indexes", **options
    )


def fit(module, data, steps=2, callbacks=(), **options) -> L.Trainer:
    trainer = L.Trainer(
        max_steps=steps,
        accelerator="cpu",
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
        val_check_interval=steps,
        check_val_every_n_epoch=None,
        callbacks=list(callbacks),
        **options,
    )
    trainer.fit(module, data)
    return trainer


class Watch(L.Callback):
    """Keeps what the steps give."""

    def __init__(self) -> None:
        self.metrics: dict[str, float] = {}
        self.validated: list[VerifiedPair] = []

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx) -> None:
        self.metrics.update({name: float(value) for name, value in trainer.callback_metrics.items()})

    def on_validation_batch_end(self, trainer, pl_module, outputs, batch, batch_idx, dataloader_idx=0) -> None:
        self.validated.append(outputs)

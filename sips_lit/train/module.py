"""The LightningModule: score network, sparse inlierness loss, validation of pairs."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import Any

import cv2
import lightning as L
import numpy as np
import torch
from torch import Tensor
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LRScheduler

from sips_lit.detect.score_network import Gradient, ScoreNetwork
from sips_lit.detect.selection import PointSelector, SelectedPoints, image_tensor, logits_at
from sips_lit.errors import BadInputError
from sips_lit.inliers.verification import verify
from sips_lit.train.datamodule import PairDataModule
from sips_lit.train.dataset import unpack
from sips_lit.train.loader import LabelledPair
from sips_lit.train.loss import consistency_loss, constant_loss, inlierness_loss, ranking_loss
from sips_lit.types import Features, GreyImage, Reason


class SipsModule(L.LightningModule):
    """Trains a score network on labelled pairs; a step is one pair.

    ``optimizer`` makes an optimiser of the parameters; ``scheduler``, if any, a schedule of the optimiser and the
    number of steps (``T_max``). ``points``: how many are selected in each image; ``consistency`` and ``ranking``:
    weights of `consistency_loss`, whose ``beta`` is ``consistency_beta``, and `ranking_loss`, added to the inlierness loss
    (0: the paper's loss); ``gradient``: see `ScoreNetwork.at`. Raises BadInputError for a negative weight or ``beta``.
    """

    def __init__(
        self,
        network: ScoreNetwork,
        selector: PointSelector,
        optimizer: Callable[..., Optimizer],
        scheduler: Callable[..., LRScheduler] | None = None,
        points: int = 500,
        consistency: float = 0.3,
        consistency_beta: float = 0.5,
        ranking: float = 30.0,
        gradient: Gradient = "patches",
    ) -> None:
        super().__init__()
        if min(consistency, consistency_beta, ranking) < 0:
            raise BadInputError(
                "consistency, consistency_beta and ranking of the module can't be negative: they are "
                f"{consistency:g}, {consistency_beta:g} and {ranking:g}"
            )
        self.network, self.selector = network, selector
        self.make_optimizer, self.make_scheduler = optimizer, scheduler
        self.points, self.gradient = points, gradient
        self.consistency, self.consistency_beta, self.ranking = consistency, consistency_beta, ranking
        self.save_hyperparameters({"network": dict(network.config), "selector": asdict(selector)}, logger=False)

    def forward(self, image: Tensor) -> Tensor:
        """Logits (B, 1, H, W) of images (B, 1, H, W)."""
        logits: Tensor = self.network(image)
        return logits

    def select(self, image: GreyImage) -> SelectedPoints:
        """The points of an image (H, W) that the network selects now."""
        with self.trainer.precision_plugin.forward_context():
            return self.selector.select(self.network, image_tensor(image, self.device), self.points)

    def training_step(self, pair: LabelledPair, batch_idx: int) -> Tensor:
        """Summed loss over the points of both images, and over their matches."""
        sides = (pair.image0, pair.points0, pair.labels0), (pair.image1, pair.points1, pair.labels1)
        logits = [logits_at(self.network, image, points, self.gradient) for image, points, _ in sides]
        loss = torch.zeros((), device=self.device)
        for of_side, (_, _, labels) in zip(logits, sides, strict=True):
            share, known = (torch.from_numpy(a).to(of_side.device) for a in (labels.share, labels.known))
            loss = loss + inlierness_loss(of_side, share, known)
        self._log_labels(pair, loss)
        index0, index1, last = (
            torch.from_numpy(a).to(self.device) for a in (pair.inliers.index0, pair.inliers.index1, pair.inliers.last)
        )
        difference = consistency_loss(logits[0][index0], logits[1][index1], self.consistency_beta)
        shortfall = ranking_loss(logits[0], logits[1], index0, index1, last)
        self.log("train/consistency", difference.detach() / max(1, len(index0)), batch_size=1)
        self.log("train/shortfall", shortfall.detach(), batch_size=1)
        return loss + self.consistency * difference + self.ranking * shortfall

    def _log_labels(self, pair: LabelledPair, loss: Tensor) -> None:
        known = np.concatenate([pair.labels0.known, pair.labels1.known])
        reason = np.concatenate([pair.labels0.reason, pair.labels1.reason])[known]
        count = max(1, len(reason))
        rates = {f"labels/{r.name.lower()}": float((reason == r).sum() / count) for r in Reason if r != Reason.UNKNOWN}
        source = self.data.sources[pair.source].name
        self.log_dict({**rates, f"inlier_rate/{source}": rates["labels/inlier"]}, batch_size=1)
        self.log("train/points", float(len(known)), batch_size=1)
        self.log("data/skipped_pairs", float(pair.skipped), batch_size=1)
        mean_loss = loss.detach() / count
        self.log("train/loss", mean_loss, prog_bar=True, batch_size=1)
        self.log("train/excess_loss", mean_loss - constant_loss(rates["labels/inlier"]), batch_size=1)
        self.log("inliers", rates["labels/inlier"], prog_bar=True, logger=False, batch_size=1)

    def on_before_optimizer_step(self, optimizer: Optimizer) -> None:
        """Logs the learning rate of the step that follows: once, of however many pairs the step is."""
        self.log(f"lr-{type(optimizer).__name__}", optimizer.param_groups[0]["lr"], batch_size=1)

    def validation_step(self, packed: Any, batch_idx: int) -> Any:
        """A validation pair as a `VerifiedPair`, for the validation callbacks; None for one that counted before."""
        if self.data.repeated(batch_idx):
            return None
        item = unpack(packed)
        check = self.data.check_of(self.data.val_sources[item.source])
        return verify(item.pair, self._features(item.pair.image0), self._features(item.pair.image1), check)

    def _features(self, image: GreyImage) -> Features:
        keypoints, descriptor = self.select(image).keypoints, self.data.descriptor
        return Features(keypoints, descriptor.describe(image, keypoints), descriptor.norm)

    @property
    def data(self) -> PairDataModule:
        """The DataModule that this module is trained with."""
        data: PairDataModule = self.trainer.datamodule  # type: ignore[attr-defined]  # set by Trainer.fit
        return data

    def on_validation_start(self) -> None:
        """Nothing is labelled during a validation: verification takes all cores."""
        self._threads = cv2.getNumThreads()
        cv2.setNumThreads(-1)

    def on_validation_end(self) -> None:
        """As in training again."""
        cv2.setNumThreads(self._threads)

    def configure_optimizers(self) -> Any:
        """Optimiser and, if any, a schedule that ends with the last step of the run."""
        optimizer, scheduler = self._optimization(self.network.parameters())
        if scheduler is None:
            return optimizer
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": scheduler, "interval": "step"}}

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Learning rate and schedule become those of this run at the step that was reached: its length may be another one.

        Taken over from the checkpoint they would end where the run was to end that wrote it, and rise again after that.
        """
        optimizer, scheduler = self._optimization([torch.zeros(1, requires_grad=True)])
        if scheduler is not None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the optimiser makes no step here
                for _ in range(checkpoint["global_step"]):
                    scheduler.step()
        checkpoint["lr_schedulers"] = [] if scheduler is None else [scheduler.state_dict()]
        for stored, own in zip(checkpoint["optimizer_states"][0]["param_groups"], optimizer.param_groups, strict=True):
            stored.update({name: value for name, value in own.items() if name != "params"})

    def _optimization(self, parameters: Iterable[Tensor]) -> tuple[Optimizer, LRScheduler | None]:
        optimizer = self.make_optimizer(parameters)
        if self.make_scheduler is None:
            return optimizer, None
        return optimizer, self.make_scheduler(optimizer, T_max=self.trainer.max_steps)

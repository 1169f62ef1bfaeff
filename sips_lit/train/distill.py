"""Distillation: a small network learns the probability that a trained one gives every pixel."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LRScheduler

from sips_lit.detect.checkpoint import digest_of
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.train.crops import CropBatch
from sips_lit.train.dense_loss import logit_loss, soft_target_loss
from sips_lit.train.score_module import ScoreModule


class DistillModule(ScoreModule):
    """Trains a score network to give what ``teacher`` gives, on crops that both see alike; a step is a batch of crops.

    ``emphasis`` and ``bound``: see `soft_target_loss` and `logit_loss`; ``logit_weight``: weight of the latter; the other
    arguments: see `ScoreModule`. Raises BadInputError for a negative weight, and a ``bound`` that is not positive.
    """

    teacher: ScoreNetwork

    def __init__(
        self,
        network: ScoreNetwork,
        selector: PointSelector,
        teacher: ScoreNetwork,
        optimizer: Callable[..., Optimizer],
        scheduler: Callable[..., LRScheduler] | None = None,
        points: int = 500,
        emphasis: float = 20.0,
        logit_weight: float = 0.1,
        bound: float = 8.0,
        compiled: bool = False,
    ) -> None:
        super().__init__(network, selector, optimizer, scheduler, points, compiled)
        if min(emphasis, logit_weight) < 0 or not bound > 0:
            raise BadInputError(
                "emphasis and logit_weight of the module can't be negative, and bound must be positive: they are "
                f"{emphasis:g}, {logit_weight:g} and {bound:g}"
            )
        # not as a submodule: it is neither trained nor averaged, nor stored with the student
        self.__dict__["teacher"] = teacher.eval().requires_grad_(False)
        self.emphasis, self.logit_weight, self.bound = emphasis, logit_weight, bound

    @property
    def margin(self) -> int:
        """Pixels around a crop that the logits of its pixels depend on: those of the larger receptive field."""
        return max(self.network.radius, self.teacher.radius)

    @property
    def learns_from(self) -> dict[str, str]:
        """The teacher's weights: its file may have been written anew."""
        return {"weights of teacher": digest_of(self.teacher)}

    def on_fit_start(self) -> None:
        """Brings the teacher to where the student is."""
        self.teacher.to(self.device)

    def training_step(self, batch: CropBatch, batch_idx: int) -> Tensor:
        """Weighted cross-entropy with the teacher's probabilities, and the distance of the logits."""
        images = batch.images.float()
        with torch.no_grad():
            target = self.teacher.interior(images, self.margin)
            floor = soft_target_loss(target, target, batch.inside, self.emphasis)
        logits = self.network.interior(images, self.margin)
        entropy = soft_target_loss(logits, target, batch.inside, self.emphasis)
        difference = logit_loss(logits, target, batch.inside, self.bound)
        loss = entropy + self.logit_weight * difference
        self.log("train/loss", loss.detach(), prog_bar=True, batch_size=1)
        self.log("train/excess_loss", loss.detach() - floor, prog_bar=True, batch_size=1)
        self.log("train/logit_difference", difference.detach(), batch_size=1)
        self.log("data/skipped_frames", float(self.data.skipped.count), batch_size=1)
        return loss

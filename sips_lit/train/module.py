"""The LightningModule of training from pairs: the sparse inlierness loss at the points that the network selects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LRScheduler
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from sips_lit.detect.score_network import Gradient, ScoreNetwork
from sips_lit.detect.selection import OneOctave, PointSelector, SelectedPoints, logits_at
from sips_lit.errors import BadInputError
from sips_lit.train.loader import LabelledPair
from sips_lit.train.loss import consistency_loss, constant_loss, inlierness_loss, ranking_loss
from sips_lit.train.score_module import ScoreModule
from sips_lit.types import GreyImage, Reason


class SipsModule(ScoreModule):
    """Trains a score network on labelled pairs; a step is one pair.

    ``consistency`` and ``ranking``: weights of `consistency_loss`, whose ``beta`` is ``consistency_beta``, and
    `ranking_loss`, added to the inlierness loss (0: the paper's loss); ``teacher_decay``: above 0, the points that are
    labelled are selected by a teacher, whose weights are the exponential mean of the network's over the steps with that
    decay (our choice); ``gradient``: see `ScoreNetwork.at`; the others: see `ScoreModule`. Raises BadInputError for a
    negative weight or ``beta``, and for a decay that is not from 0 to less than 1.
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
        teacher_decay: float = 0.0,
        gradient: Gradient = "patches",
        compiled: bool = False,
    ) -> None:
        if not 0 <= teacher_decay < 1:
            raise BadInputError(f"teacher_decay of the module is {teacher_decay:g}: give 0, or more and less than 1")
        # copied before it is compiled: the copy would call the network's own function
        mean = get_ema_multi_avg_fn(teacher_decay)  # type: ignore[no-untyped-call]  # torch's
        teacher = AveragedModel(network, multi_avg_fn=mean) if teacher_decay else None
        super().__init__(network, selector, optimizer, scheduler, points, compiled)
        self.teacher = None if teacher is None else teacher.requires_grad_(False)
        if min(consistency, consistency_beta, ranking) < 0:
            raise BadInputError(
                "consistency, consistency_beta and ranking of the module can't be negative: they are "
                f"{consistency:g}, {consistency_beta:g} and {ranking:g}"
            )
        self.gradient = gradient
        self.consistency, self.consistency_beta, self.ranking = consistency, consistency_beta, ranking

    def select_to_train(self, image: GreyImage) -> SelectedPoints:
        """See `ScoreModule`: by the teacher where there is one."""
        if self.teacher is None:
            return super().select_to_train(image)
        return self._select(self.selector.anywhere, OneOctave(cast(ScoreNetwork, self.teacher.module)), image)

    def optimizer_step(self, *args: Any, **kwargs: Any) -> None:
        """The teacher follows the network at once: a checkpoint of the step holds both."""
        super().optimizer_step(*args, **kwargs)
        if self.teacher is not None:
            self.teacher.update_parameters(self.network)

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

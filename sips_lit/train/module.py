"""The LightningModule of training from pairs: the sparse inlierness loss at the points that the network selects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast, get_args

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LRScheduler
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from sips_lit.detect.score_network import Gradient, ScoreNetwork
from sips_lit.detect.selection import OneOctave, PointSelector, SelectedPoints, logits_at
from sips_lit.errors import BadInputError
from sips_lit.train.gradient_route import RememberedCosts, RouteCosts, measured_costs, setting
from sips_lit.train.loader import LabelledPair
from sips_lit.train.loss import consistency_loss, constant_loss, inlierness_loss, ranking_loss
from sips_lit.train.score_module import ScoreModule
from sips_lit.train.source_focus import Focus, SourceFocus
from sips_lit.types import GreyImage, Reason


class _Loss(NamedTuple):
    """Of a pair: what is minimised, and what is told of it."""

    total: Tensor
    told: dict[str, Tensor]


class SipsModule(ScoreModule):
    """Trains a score network on labelled pairs, ``accumulate_grad_batches`` of the trainer a step.

    ``consistency`` and ``ranking``: weights of `consistency_loss`, whose ``beta`` is ``consistency_beta``, and
    `ranking_loss`, added to the inlierness loss (0: the paper's loss); ``teacher_decay``: above 0, the points that are
    labelled are selected by a teacher, whose weights are the exponential mean of the network's over the steps with that
    decay (our choice); ``gradient``: see `ScoreNetwork.at`, or ``auto``, the route that takes less time by what both were
    once measured to cost, which ``gradient_costs`` remembers (a file; None: the run alone); ``pairs_at_once``: how many
    pairs of a step the network sees together, whose activations are in memory together, too; ``focus``: what the weights
    of the sources follow (`SourceFocus`), None: nothing, they are as configured; the others: see `ScoreModule`.
    Raises BadInputError for a negative weight or ``beta``, for a decay that is not from 0 to less than 1, for another
    ``gradient`` or ``focus``, for ``pairs_at_once`` below 1, and at the start of a run whose steps have fewer pairs.
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
        gradient: Gradient | Literal["auto"] = "patches",
        gradient_costs: str | Path | None = None,
        pairs_at_once: int = 1,
        compiled: bool = False,
        focus: Focus | None = None,
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
        if pairs_at_once < 1:
            raise BadInputError(f"pairs_at_once of the module counts pairs, from 1, and is {pairs_at_once}")
        if gradient not in (*get_args(Gradient), "auto"):
            raise BadInputError(f"gradient of the module is {gradient}: give patches, dense or auto")
        if focus not in (None, *get_args(Focus)):
            raise BadInputError(f"focus of the module is {focus}: give difficulty or progress, or null for neither")
        self.gradient, self.pairs_at_once, self.compiled = gradient, pairs_at_once, compiled
        self.focus: Focus | None = focus
        self._source_focus: SourceFocus | None = None
        self._stored_focus: dict[str, Any] = {}
        self._losses_of_step: list[tuple[str, Tensor]] = []
        self._remembered = RememberedCosts(None if gradient_costs is None else Path(gradient_costs))
        self._costs: dict[str, RouteCosts] = {}
        self._held: list[LabelledPair] = []
        self.consistency, self.consistency_beta, self.ranking = consistency, consistency_beta, ranking

    def select_to_train(self, images: Sequence[GreyImage]) -> list[SelectedPoints]:
        """See `ScoreModule`: by the teacher where there is one."""
        if self.teacher is None:
            return super().select_to_train(images)
        return self._select(self.selector.anywhere, OneOctave(cast(ScoreNetwork, self.teacher.module)), images)

    def optimizer_step(self, *args: Any, **kwargs: Any) -> None:
        """The teacher and the weights of the sources follow the network at once: a checkpoint of the step holds all."""
        super().optimizer_step(*args, **kwargs)
        if self.teacher is not None:
            self.teacher.update_parameters(self.network)
        if self._source_focus is not None:
            self._source_focus.learn(self._mean_losses(list(self._source_focus.odds)))

    def _mean_losses(self, sources: Sequence[str]) -> dict[str, float]:
        """Of the step's pairs by source, those of all processes; without the sources that it has no pair of."""
        sums = torch.zeros(2, len(sources), device=self.device)
        for source, loss in self._losses_of_step:
            sums[:, sources.index(source)] += torch.stack([loss, torch.ones_like(loss)])
        self._losses_of_step = []
        totals, counts = self.trainer.strategy.reduce(sums, reduce_op="sum").tolist()
        return {name: total / n for name, total, n in zip(sources, totals, counts, strict=True) if n}

    def on_fit_start(self) -> None:
        """Weighs the sources of the data; raises BadInputError where a step has fewer pairs than are seen at once."""
        pairs = self.trainer.accumulate_grad_batches
        if self.pairs_at_once > pairs:
            raise BadInputError(
                f"module.pairs_at_once is {self.pairs_at_once}, but a step has trainer.accumulate_grad_batches={pairs} "
                "pairs: lower the one or raise the other"
            )
        if self.focus is not None:
            odds: dict[str, float] = {}
            for source in self.data.sources:
                odds[source.name] = odds.get(source.name, 0.0) + source.weight
            self._source_focus = SourceFocus(self.focus, odds)
            self._source_focus.load_state_dict(self._stored_focus)

    def training_step(self, pair: LabelledPair, batch_idx: int) -> Tensor:
        """Summed loss over the points of both images, and over their matches, of the pairs that the network sees at once.

        A pair that others of its step are waited for with has a loss of 0; its own is in the sum of theirs.
        """
        self._log_labels(pair)
        self._held.append(pair)
        if len(self._held) < self.pairs_at_once and (batch_idx + 1) % self.trainer.accumulate_grad_batches:
            return torch.zeros((), device=self.device, requires_grad=True)
        pairs, self._held = self._held, []
        images = [image for held in pairs for image in (held.image0, held.image1)]
        points = [of_image for held in pairs for of_image in (held.points0, held.points1)]
        logits = logits_at(self.network, images, points, self._route(images, points))
        losses = [self._loss(*sides) for sides in zip(pairs, logits[::2], logits[1::2], strict=True)]
        for name in losses[0].told:
            mean = torch.stack([loss.told[name] for loss in losses]).mean()
            self.log(f"train/{name}", mean, prog_bar=name == "loss", batch_size=1)
        totals = [loss.total * self._weight(held, loss) for held, loss in zip(pairs, losses, strict=True)]
        return torch.stack(totals).sum()

    def _weight(self, pair: LabelledPair, loss: _Loss) -> float:
        """What the loss of a pair counts by its source, which learns of the loss at the end of the step."""
        if self._source_focus is None:
            return 1.0
        source = self.data.sources[pair.source].name
        if len(_known_reasons(pair)):
            self._losses_of_step.append((source, loss.told["loss"].float()))
        weight = self._source_focus[source]
        self.log(f"source_weight/{source}", weight, batch_size=1)
        return weight

    def _route(self, images: Sequence[Tensor], points: Sequence[SelectedPoints]) -> Gradient:
        if self.gradient != "auto":
            return self.gradient
        of = setting(self.network, self.device, str(self.trainer.precision), self.compiled)
        if of not in self._costs:
            costs = self._remembered.get(of)
            if costs is None:
                if not any(map(len, points)):
                    return "patches"
                costs = measured_costs(self.network, images, points)
                self._remembered.put(of, costs)
            self._costs[of] = costs
            self.print(f"gradient:    {costs}")
        return self._costs[of].faster(images, points)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """What routes of the gradient cost, and what sources weigh: a run that goes on from it takes the same ones."""
        checkpoint["gradient_costs"] = {of: asdict(costs) for of, costs in self._costs.items()}
        if self._source_focus is not None:
            checkpoint["source_focus"] = self._source_focus.state_dict()

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """See `ScoreModule`; and the costs and the losses of sources that the run went by."""
        super().on_load_checkpoint(checkpoint)
        self._stored_focus = checkpoint.get("source_focus", {})
        stored = checkpoint.get("gradient_costs", {})
        self._costs = {of: RouteCosts(**costs) for of, costs in stored.items()}

    def _loss(self, pair: LabelledPair, logits0: Tensor, logits1: Tensor) -> _Loss:
        inlierness = torch.zeros((), device=self.device)
        for of_side, labels in ((logits0, pair.labels0), (logits1, pair.labels1)):
            share, known = (torch.from_numpy(a).to(of_side.device) for a in (labels.share, labels.known))
            inlierness = inlierness + inlierness_loss(of_side, share, known)
        index0, index1, last = (
            torch.from_numpy(a).to(self.device) for a in (pair.inliers.index0, pair.inliers.index1, pair.inliers.last)
        )
        difference = consistency_loss(logits0[index0], logits1[index1], self.consistency_beta)
        shortfall = ranking_loss(logits0, logits1, index0, index1, last)
        reason = _known_reasons(pair)
        mean = inlierness.detach() / max(1, len(reason))
        told = {
            "loss": mean,
            "excess_loss": mean - constant_loss(float((reason == Reason.INLIER).sum()) / max(1, len(reason))),
            "consistency": difference.detach() / max(1, len(index0)),
            "shortfall": shortfall.detach(),
        }
        return _Loss(inlierness + self.consistency * difference + self.ranking * shortfall, told)

    def _log_labels(self, pair: LabelledPair) -> None:
        reason = _known_reasons(pair)
        count = max(1, len(reason))
        rates = {f"labels/{r.name.lower()}": float((reason == r).sum() / count) for r in Reason if r != Reason.UNKNOWN}
        source = self.data.sources[pair.source].name
        self.log_dict({**rates, f"inlier_rate/{source}": rates["labels/inlier"]}, batch_size=1)
        self.log("train/points", float(len(pair.points0) + len(pair.points1)), batch_size=1)
        self.log("data/skipped_pairs", float(pair.skipped), batch_size=1)
        self.log("inliers", rates["labels/inlier"], prog_bar=True, logger=False, batch_size=1)


def _known_reasons(pair: LabelledPair) -> NDArray[np.uint8]:
    known = np.concatenate([pair.labels0.known, pair.labels1.known])
    reasons: NDArray[np.uint8] = np.concatenate([pair.labels0.reason, pair.labels1.reason])[known]
    return reasons

"""Whether a training can work at all: images without points, labels without inliers, pairs that never succeed."""

from __future__ import annotations

from typing import Any

import lightning as L
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torchmetrics import Metric

from sips_lit.errors import BadInputError, warn_input
from sips_lit.inliers.point_labels import point_labels
from sips_lit.inliers.verification import VerifiedPair
from sips_lit.train.loader import LabelledPair
from sips_lit.types import Reason

WHY = {
    Reason.UNMATCHED: "have no match",
    Reason.LOST: "have no correspondence (lost, outside or hidden)",
    Reason.FAR: "match too far from the true place",
    Reason.UNKNOWN: "are where the truth is not known",
}
TEXTURE = "they lack texture or contrast: look at them with sips-data check"
LABELS = "see whether frames, order, poses and calibration fit inliers=..."


class Prospects(L.Callback):
    """Warns where a training gets nowhere, and ends one that can't get anywhere.

    A warning: ``stretch`` training pairs in a row with fewer than ``k`` points or without an inlier, and a validation in
    which no pair has ``k`` inliers within ``n_max`` points (succinctness AUC 0); each of them may pass. ``failure`` says
    why it was so in the last validation; None if a pair succeeded. Raises BadInputError at a validation when ``stretch``
    training pairs or more and all of the validation had not one inlier: then there is nothing to learn from.
    """

    def __init__(self, k: int = 10, n_max: int = 200, stretch: int = 100) -> None:
        self.k, self.n_max, self.stretch = k, n_max, stretch
        self.failure: str | None = None
        self.poor = self.barren = 0  # training pairs in a row with too few points, and without inliers
        self.trained, self.validated = Seen(), Seen()

    def on_fit_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Starts from no pairs, beside the module."""
        self.trained, self.validated = Seen().to(pl_module.device), Seen().to(pl_module.device)

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Counts a pair, and warns after a stretch; a batch without labels says nothing."""
        if not isinstance(batch, LabelledPair):
            return
        points, reasons = (
            min(len(batch.points0), len(batch.points1)),
            _count(batch.labels0.reason, batch.labels1.reason),
        )
        self.trained.update(points, reasons)
        self.poor = self.poor + 1 if points < self.k else 0
        self.barren = 0 if reasons[Reason.INLIER] else self.barren + 1
        if self.poor == self.stretch and trainer.is_global_zero:
            warn_input(f"the images of {self.poor} training pairs in a row gave fewer than {self.k} points: {TEXTURE}")
        if self.barren == self.stretch and trainer.is_global_zero:
            last = f"of the last one's points {_in_words(reasons)}"
            warn_input(f"{self.barren} training pairs in a row had no inlier ({last}): {LABELS}")

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Starts from no validation pairs."""
        self.validated.reset()

    def on_validation_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, *_: Any, **__: Any
    ) -> None:
        """Counts a validation pair."""
        if outputs is None:
            return
        assert isinstance(outputs, VerifiedPair)
        matches, inliers = outputs.at(self.n_max)
        labels0 = point_labels(inliers, matches.index0, inliers.known0)
        labels1 = point_labels(inliers, matches.index1, inliers.known1)
        points, needed = min(len(labels0.reason), len(labels1.reason)), outputs.points_needed(self.k, self.n_max)
        succeeded = needed is not None and needed < self.n_max  # else it adds nothing to the AUC
        self.validated.update(points, _count(labels0.reason, labels1.reason), succeeded)

    def on_validation_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Says why no pair succeeded, if none did."""
        trained, validated = self.trained.result(), self.validated.result()
        self.failure = why_none_succeeded(validated, self.k, self.n_max)
        if self.failure is None:
            return
        if trained["pairs"] >= self.stretch and not trained["most_inliers"] and not validated["most_inliers"]:
            seen = f"{trained['pairs']} training pairs had no inlier"
            raise BadInputError(f"there is nothing to learn: {seen}, and {self.failure}")
        if trainer.is_global_zero:
            warn_input(f"step {trainer.global_step}: {self.failure}")


def why_none_succeeded(seen: dict[str, Any], k: int, n_max: int) -> str | None:
    """In words, from what was `Seen` of validation pairs; None if one succeeded, or there were none."""
    if not seen["pairs"] or seen["succeeded"]:
        return None
    points, inliers = seen["most_points"], seen["most_inliers"]
    if points < k:
        return f"the images of no validation pair have more than {points} points, and k = {k} inliers are needed: {TEXTURE}"
    if not inliers:
        return f"no validation pair has an inlier (of the points {_in_words(seen['reasons'])}): {LABELS}"
    return (
        f"no validation pair has k = {k} inliers among fewer than n_max = {n_max} points, the best has {inliers}: "
        "train longer, or ask for fewer or among more (k=... n_max=... module.points=...)"
    )


class Seen(Metric):
    """What pairs had, merged exactly across processes."""

    full_state_update = False
    pairs: Tensor
    succeeded: Tensor
    most_points: Tensor
    most_inliers: Tensor
    reasons: Tensor

    def __init__(self) -> None:
        super().__init__()
        for name, reduce in (("pairs", "sum"), ("succeeded", "sum"), ("most_points", "max"), ("most_inliers", "max")):
            self.add_state(name, torch.zeros((), dtype=torch.long), dist_reduce_fx=reduce)
        self.add_state("reasons", torch.zeros(len(Reason), dtype=torch.long), dist_reduce_fx="sum")

    def update(self, points: int, reasons: NDArray[np.int64], succeeded: bool = False) -> None:
        """Add a pair: the fewer of its images' points, `Reason` of the points of both (counts), whether it has k inliers."""
        self.pairs += 1
        self.succeeded += int(succeeded)
        self.most_points = self.most_points.clamp(min=points)
        self.most_inliers = self.most_inliers.clamp(
            min=int(reasons[Reason.INLIER]) // 2
        )  # an inlier is a point in both
        self.reasons += torch.from_numpy(reasons).to(self.reasons.device)

    def compute(self) -> dict[str, Tensor]:
        """The sums and maxima by name."""
        return {name: getattr(self, name) for name in self._defaults}

    def result(self) -> dict[str, Any]:
        """The same as plain numbers. In distributed runs every process must call it, and each gets that of all pairs."""
        with self.sync_context(self.dist_sync_fn, distributed_available=self.distributed_available_fn):
            return {name: getattr(self, name).tolist() for name in self._defaults}


def _count(*reasons: NDArray[np.uint8]) -> NDArray[np.int64]:
    return np.bincount(np.concatenate(reasons), minlength=len(Reason))


def _in_words(reasons: Any) -> str:
    """Shares of the points, the largest first."""
    shares = sorted(((reasons[reason] / max(1, sum(reasons)), why) for reason, why in WHY.items()), reverse=True)
    return ", ".join(f"{share:.0%} {why}" for share, why in shares if share >= 0.005) or "there are none"

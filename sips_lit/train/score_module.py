"""What every training of a score network shares: selection, validation by verified pairs, optimiser and schedule."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Any, ClassVar, Literal

import cv2
import lightning as L
import torch
from torch import Tensor
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LRScheduler

from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import OneOctave, PointSelector, Scorer, SelectedPoints, image_tensor
from sips_lit.errors import BadInputError
from sips_lit.inliers.verification import verify
from sips_lit.train.compiled import compile_layers
from sips_lit.train.dataset import unpack
from sips_lit.train.validation_data import ValidationDataModule
from sips_lit.types import Features, GreyImage


class ScoreModule(L.LightningModule):
    """Validates a score network by the points that it selects, optimises and stores it; subclasses say how it learns.

    ``optimizer`` makes an optimiser of the parameters; ``scheduler``, if any, a schedule of the optimiser and the
    number of steps (``T_max``). ``points``: how many are selected in each image. ``compiled``: see `compile_layers`.
    Raises BadInputError for a network with a covariance head where scores are learned, and for one without where
    covariances are.
    """

    learns: ClassVar[Literal["scores", "covariance"]] = "scores"
    """What a run is about: what is best is judged by it."""
    pairs_at_once: int = 1
    """Training pairs whose images the network sees together."""

    def __init__(
        self,
        network: ScoreNetwork,
        selector: PointSelector,
        optimizer: Callable[..., Optimizer],
        scheduler: Callable[..., LRScheduler] | None = None,
        points: int = 500,
        compiled: bool = False,
    ) -> None:
        super().__init__()
        if (network.covariance_head is not None) != (self.learns == "covariance"):
            raise BadInputError(
                "covariances are learned by experiment=covariance with model.covariance=true, after the scores: leave "
                "model.covariance as the experiment has it"
            )
        self.network, self.selector, self.points = network, selector, points
        if compiled:
            compile_layers(network)
        _refuse_optimization(optimizer, scheduler)
        self.make_optimizer, self.make_scheduler = optimizer, scheduler
        self.save_hyperparameters({"network": dict(network.config), "selector": selector.config}, logger=False)

    @property
    def learns_from(self) -> dict[str, str]:
        """What else the run depends on, by name, with a digest: two runs are the same only where it is."""
        return {}

    @property
    def trained(self) -> Iterable[Tensor]:
        """The weights that a run changes."""
        return self.network.parameters()

    def forward(self, image: Tensor) -> Tensor:
        """Logits (B, 1, H, W) of images (B, 1, H, W)."""
        logits: Tensor = self.network(image)
        return logits

    def select(self, image: GreyImage) -> SelectedPoints:
        """The points of an image (H, W) that the network selects now."""
        return self._select(self.selector, self.network, [image])[0]

    def select_to_train(self, images: Sequence[GreyImage]) -> list[SelectedPoints]:
        """The points of images (H, W) that are labelled: by the octave that the network learns from, up to the border."""
        return self._select(self.selector.anywhere, OneOctave(self.network), images)

    def _select(self, selector: PointSelector, network: Scorer, images: Sequence[GreyImage]) -> list[SelectedPoints]:
        """The network sees images of one size together."""
        of_size: dict[tuple[int, ...], list[int]] = {}
        for number, image in enumerate(images):
            of_size.setdefault(image.shape, []).append(number)
        found: dict[int, SelectedPoints] = {}
        for numbers in of_size.values():
            batch = torch.cat([image_tensor(images[number], self.device) for number in numbers])
            with self.trainer.precision_plugin.forward_context():
                found |= zip(numbers, selector.select_each(network, batch, self.points), strict=True)
        return [found[number] for number in range(len(images))]

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
    def data(self) -> ValidationDataModule:
        """The DataModule that this module is trained with."""
        data: ValidationDataModule = self.trainer.datamodule  # type: ignore[attr-defined]  # set by Trainer.fit
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
        optimizer, scheduler = self._optimization(self.trained)
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


def _refuse_optimization(optimizer: Callable[..., Optimizer], scheduler: Callable[..., LRScheduler] | None) -> None:
    """Raises BadInputError for those that can't be made, which else is found after all data were prepared."""
    try:
        made = optimizer([torch.zeros(1, requires_grad=True)])
        if scheduler is not None:
            scheduler(made, T_max=1)
    except (TypeError, ValueError) as error:
        raise BadInputError(f"the optimizer or its schedule (optim) can't be made: {error}") from error

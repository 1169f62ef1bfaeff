"""The DataModule of training from pairs: overlap indexes, pairs, and labels made one step ahead."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source
from sips_lit.pairs.build import unreadable_frames
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.pairs.sampler import SourceSampler
from sips_lit.train.augment import Augmentation
from sips_lit.train.dataset import PackedPairs, TrainingPairs
from sips_lit.train.loader import LabelledPair, OneStepAhead
from sips_lit.train.stream import LOADING_TIMEOUT
from sips_lit.train.validation_data import ValidationDataModule, warn_unreadable
from sips_lit.types import Descriptor, ImageSequence, InlierCheck


class PairDataModule(ValidationDataModule):
    """Pairs of frames with enough overlap, with labels for the points that the network selects.

    ``overlap``: least overlap of a pair to train on; ``spread``: see `PairSampler`; ``budgets``: see `label_pair`;
    ``between``: see `OneStepAhead`; ``labelling_workers``: threads that describe, match and track; the others, and what is
    raised: see `ValidationDataModule`.
    """

    what = "training pair"

    def __init__(
        self,
        data: Sequence[ImageSequence] | Sequence[Source],
        descriptor: Descriptor,
        inliers: InlierCheck,
        index_folder: str | Path,
        val_data: Sequence[ImageSequence] | Sequence[Source] | None = None,
        augmentation: Augmentation | None = None,
        overlap_parameters: OverlapParameters | None = None,
        overlap: float = 0.1,
        spread: float = 0.0,
        budgets: Sequence[int] = (),
        between: int = 0,
        val_fraction: float = 0.15,
        val_pairs: int = 30,
        val_overlap: float = 0.1,
        loading_workers: int = 2,
        labelling_workers: int = 2,
        loading_timeout: float = LOADING_TIMEOUT,
        seed: int = 0,
        val_seed: int = 0,
    ) -> None:
        super().__init__(
            data,
            descriptor,
            inliers,
            index_folder,
            val_data,
            overlap_parameters,
            val_fraction,
            val_pairs,
            val_overlap,
            loading_workers,
            loading_timeout,
            seed,
            val_seed,
        )
        if any(n < 1 for n in budgets):
            raise BadInputError(f"datamodule.budgets are numbers of points from 1 on, and are {list(budgets)}")
        if between < 0:
            raise BadInputError(f"datamodule.between counts frames between two, from 0, and is {between}")
        if labelling_workers < 0:
            raise BadInputError(f"labelling_workers of the data is {labelling_workers}: give 0 or more")
        self.augmentation, self.labelling_workers = augmentation, labelling_workers
        self.overlap, self.spread = overlap, spread
        self.budgets, self.between = list(budgets), between

    def prepare_data(self) -> None:
        """Measures the overlap indexes that are missing, those of the training data, too."""
        self._training_sampler()
        super().prepare_data()

    def setup(self, stage: str) -> None:
        """Reads the indexes and fixes the validation pairs; warns of frames that can't be read, which are in no pair."""
        self.sampler = self._training_sampler()
        warn_unreadable("frames of the training data", unreadable_frames(self.sampler.indexes))
        super().setup(stage)

    def _training_sampler(self) -> SourceSampler:
        return self._sampler(self.sources, self.overlap, self.seed, self.spread)

    def train_dataloader(self) -> OneStepAhead:
        """Labelled pairs; the points are selected by the module that is being trained."""
        steps, trainer = self.training_steps(), self.trainer
        assert trainer is not None
        pairs = TrainingPairs(self.sources, self.sampler, self.inliers, self.augmentation, steps)
        module: Any = trainer.lightning_module
        return OneStepAhead(
            PackedPairs(pairs),
            module.select_to_train,
            self.descriptor,
            [self.check_of(source) for source in self.sources],
            self.loading_workers,
            self.labelling_workers,
            first=trainer.global_rank,
            stride=trainer.world_size,
            skipped=self.skipped,
            loading_timeout=self.loading_timeout,
            budgets=self.budgets,
            between=self.between,
            pairs_per_step=trainer.accumulate_grad_batches,
            pairs_at_once=module.pairs_at_once,
        )

    def transfer_batch_to_device(self, batch: Any, device: torch.device, dataloader_idx: int) -> Any:
        """Only the images of a labelled pair go to the device."""
        return batch.to(device) if isinstance(batch, LabelledPair) else batch

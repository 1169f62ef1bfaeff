"""The DataModule of distillation: random crops of any frames to learn from, and pairs to validate on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.train.augment import Augmentation
from sips_lit.train.crops import CropBatch, CropStream, TrainingCrops
from sips_lit.train.stream import LOADING_TIMEOUT
from sips_lit.train.validation_data import ValidationDataModule
from sips_lit.types import Descriptor, ImageSequence, InlierCheck


class CropDataModule(ValidationDataModule):
    """Batches of ``crops`` random crops of ``size`` pixels; the module says how wide a margin they need.

    The other arguments: see `ValidationDataModule`. Training data may be images in no order, which validate nothing: then
    ``val_data`` is needed. Raises BadInputError without it, and for data or numbers that can't train.
    """

    what = "frame"

    def __init__(
        self,
        data: Sequence[ImageSequence] | Sequence[Source],
        descriptor: Descriptor,
        inliers: InlierCheck,
        index_folder: str | Path,
        val_data: Sequence[ImageSequence] | Sequence[Source] | None = None,
        augmentation: Augmentation | None = None,
        overlap_parameters: OverlapParameters | None = None,
        crops: int = 16,
        size: int = 160,
        val_fraction: float = 0.15,
        val_pairs: int = 30,
        val_overlap: float = 0.1,
        loading_workers: int = 2,
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
        if crops < 1 or size < 1:
            raise BadInputError(f"datamodule.crops and datamodule.size are 1 or more, not {crops} and {size}")
        for source in self.val_sources:
            stills = [s.name for s in source.sequences if not s.temporal and self.check_of(source).uses_frames]
            if stills:
                raise BadInputError(
                    f"the images of {stills[0]} are in no order, so nothing can be validated on them by tracks: give "
                    "validation data of its own, such as data@val_data=video val_data.path=..."
                )
        self.augmentation, self.crops, self.size = augmentation, crops, size

    def train_dataloader(self) -> CropStream:
        """Batches of crops."""
        steps, trainer = self.training_steps(), self.trainer
        assert trainer is not None
        margin: Any = trainer.lightning_module.margin
        crops = TrainingCrops(self.sources, self.augmentation, steps, self.seed, self.crops, self.size, margin)
        ranks, rank = self._processes
        return CropStream(crops, self.loading_workers, self.loading_timeout, self.skipped, rank, ranks)

    def transfer_batch_to_device(self, batch: Any, device: torch.device, dataloader_idx: int) -> Any:
        """Validation pairs stay where they are verified."""
        return batch.to(device) if isinstance(batch, CropBatch) else batch

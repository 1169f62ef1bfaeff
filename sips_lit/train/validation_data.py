"""What every training of a score network validates on: pairs of frames that it does not train on, always the same."""

from __future__ import annotations

import contextlib
import hashlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import lightning as L
import numpy as np
from lightning.pytorch.utilities import rank_zero_only
from torch.utils.data import DataLoader, DistributedSampler

from sips_lit.errors import BadInputError, warn_input
from sips_lit.frames.source import Source, as_sources, split_tail
from sips_lit.pairs.build import build_indexes, unreadable_frames
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.pairs.sampler import FixedPairs, PairChoice, SourceSampler, read_pair
from sips_lit.train.dataset import PackedPairs, SkippedItems
from sips_lit.train.stream import LOADING_TIMEOUT
from sips_lit.types import Descriptor, ImageSequence, InlierCheck


class ValidationDataModule(L.LightningDataModule):
    """``sources`` to train on, which a subclass draws from, and ``val_sources`` with fixed pairs for validation.

    ``data``: sequences, or sources with weights; ``val_data``: the same for validation, or None to keep the last
    ``val_fraction`` of every training sequence for it; ``descriptor`` and ``inliers``: how pairs are matched and verified;
    ``val_pairs``: how many fixed pairs validate; ``val_overlap``: their least overlap, whatever is trained on;
    ``loading_workers``: processes that decode and augment; ``loading_timeout``: seconds without anything from them after
    which they count as hung; ``index_folder``: where overlap indexes are kept; ``seed``: of what is trained on;
    ``val_seed``: of the choice of validation pairs, which is thus the same for any ``seed``. Raises BadInputError for data
    or numbers that can't train.
    """

    what = "training item"

    def __init__(
        self,
        data: Sequence[ImageSequence] | Sequence[Source],
        descriptor: Descriptor,
        inliers: InlierCheck,
        index_folder: str | Path,
        val_data: Sequence[ImageSequence] | Sequence[Source] | None = None,
        overlap_parameters: OverlapParameters | None = None,
        val_fraction: float = 0.15,
        val_pairs: int = 30,
        val_overlap: float = 0.1,
        loading_workers: int = 2,
        loading_timeout: float = LOADING_TIMEOUT,
        seed: int = 0,
        val_seed: int = 0,
    ) -> None:
        super().__init__()
        counts = ("val_pairs", val_pairs, 1), ("loading_workers", loading_workers, 0)
        for name, value, least in (*counts, ("seed", seed, 0), ("val_seed", val_seed, 0)):
            if value < least:
                raise BadInputError(f"{name} of the data is {value}: give {least} or more")
        self.descriptor, self.inliers = descriptor, inliers
        self.index_folder, self.overlap_parameters = index_folder, overlap_parameters or OverlapParameters()
        self.val_pairs, self.val_overlap = val_pairs, val_overlap
        self.seed, self.val_seed = seed, val_seed
        self.loading_workers, self.loading_timeout = loading_workers, loading_timeout
        self.skipped = SkippedItems(self.what)
        if val_data is None:
            self.sources, self.val_sources = split_tail(as_sources(data), val_fraction)
        else:
            self.sources, self.val_sources = as_sources(data), as_sources(val_data)
        if not loading_timeout > 0:
            raise BadInputError(f"loading_timeout is {loading_timeout}: give a number of seconds above 0")
        if not self.sources or not self.val_sources:
            raise BadInputError(
                f"the sequences are too short to keep {val_fraction:.0%} of each for validation: give more frames, a larger "
                "datamodule.val_fraction, or validation data of its own (data@val_data=... val_data.path=...)"
            )

    def check_of(self, source: Source) -> InlierCheck:
        """The inlier check that labels or verifies pairs of a source."""
        return source.inliers or self.inliers

    def prepare_data(self) -> None:
        """Measures the overlap indexes that are missing (on one process of each machine)."""
        self._val_sampler()  # tells of data without pairs before processes start

    def setup(self, stage: str) -> None:
        """Fixes the validation pairs; warns of frames that can't be read, which are in no pair."""
        val_sampler = self._val_sampler()
        warn_unreadable("frames of the validation data", unreadable_frames(val_sampler.indexes))
        unreadable: list[str] = []

        def usable(at: int, choice: PairChoice) -> bool:
            source = self.val_sources[at]
            sequence, check = source.sequences[choice.sequence], self.check_of(source)
            if not check.uses_depth and sequence.homography(choice.index0, choice.index1) is None:
                return True  # the overlap index has seen all that is read of it
            try:
                read_pair(sequence, choice.index0, choice.index1, check.uses_frames, check.uses_depth)
            except BadInputError as error:
                unreadable.append(str(error))
                return False
            return True

        self.val_choices = val_sampler.fixed(self.val_pairs, usable)
        warn_unreadable("validation pairs", unreadable)
        if not self.val_choices:
            raise BadInputError(f"no validation pair can be read; the first: {unreadable[0]}")
        if len(self.val_choices) < self.val_pairs:
            warn_input(
                f"{self.val_pairs} validation pairs are asked for, and only {len(self.val_choices)} different ones "
                f"overlap by {self.val_overlap:g}"
            )

    def _val_sampler(self) -> SourceSampler:
        return self._sampler(self.val_sources, self.val_overlap, self.val_seed, key="val_overlap")

    def _sampler(
        self, sources: list[Source], overlap: float, seed: int, spread: float = 0.0, key: str = "overlap"
    ) -> SourceSampler:
        sequences = [sequence for source in sources for sequence in source.sequences]
        indexes = build_indexes(sequences, self.index_folder, self.overlap_parameters, self.loading_workers)
        try:
            return SourceSampler(sources, indexes, overlap, seed, spread=spread)
        except BadInputError as error:
            raise BadInputError(f"{error} (datamodule.{key})") from error

    def training_steps(self) -> int:
        """How many batches all processes of this run take together. Raises BadInputError unless it is counted in steps."""
        trainer = self.trainer
        if trainer is None or trainer.max_steps <= 0:
            raise BadInputError("training is counted in steps: set trainer.max_steps to a positive number")
        return int(trainer.max_steps * trainer.accumulate_grad_batches * trainer.world_size)

    def val_dataloader(self) -> DataLoader[Any]:
        """Fixed pairs, packed; each process takes its share, and as many as any other: see `repeated`."""
        pairs = PackedPairs(FixedPairs(self.val_sources, self.val_choices, self.inliers))
        ranks, rank = self._processes
        sampler: DistributedSampler[Any] = DistributedSampler(pairs, ranks, rank, shuffle=False)
        return DataLoader(pairs, batch_size=None, num_workers=0, sampler=sampler)

    def repeated(self, batch_idx: int) -> bool:
        """Whether validation batch ``batch_idx`` of this process is a pair that counted before, in one of the processes.

        Where the number of pairs is no multiple of that of processes, the sampler begins again with the first pair.
        """
        ranks, rank = self._processes
        return batch_idx * ranks + rank >= len(self.val_choices)

    @property
    def _processes(self) -> tuple[int, int]:
        """How many processes train, and which of them this is."""
        return (self.trainer.world_size, self.trainer.global_rank) if self.trainer else (1, 0)

    def data_digest(self) -> str:
        """Changes when the frames or the weights of the sources change, of training or of validation."""
        used = [
            (source.name, source.weight, [(s.name, s.fingerprint, len(s)) for s in source.sequences])
            for source in (*self.sources, *self.val_sources)
        ]
        return hashlib.sha256(repr(used).encode()).hexdigest()[:16]

    def sample_digest(self, count: int = 32) -> str:
        """Changes when names, numbers or pixels of some frames do; a copy that has other file times has the same."""
        sequences = [s for source in (*self.sources, *self.val_sources) for s in source.sequences]
        lengths = [len(sequence) for sequence in sequences]
        digest, ends = hashlib.sha256(repr(([s.name for s in sequences], lengths)).encode()), np.cumsum(lengths)
        for place in np.linspace(0, ends[-1] - 1, count).astype(int):
            at = int(np.searchsorted(ends, place, side="right"))
            with contextlib.suppress(BadInputError):  # a damaged frame counts by its place only
                digest.update(sequences[at].frame(int(place - ends[at] + lengths[at])).tobytes())
        return digest.hexdigest()[:16]

    def validation_pairs(self) -> list[str]:
        """Name of each fixed pair, and the size of its first image: what validates is the same where these are."""
        pairs = FixedPairs(self.val_sources, self.val_choices, self.inliers)
        return [f"{pairs.name(at)} {pairs.size(at)}" for at in range(len(pairs))]


@rank_zero_only
def warn_unreadable(what: str, reasons: Sequence[str]) -> None:
    """One line on standard error about what is left out because it can't be read, if there is any."""
    if reasons:
        print(
            f"warning: {what} can't be read and are left out ({len(reasons)}); the first: {reasons[0]}", file=sys.stderr
        )

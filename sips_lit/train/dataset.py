"""Training pairs, the count of those left out, and how pairs pass between processes: DataLoader workers make them."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset

from sips_lit.errors import BadInputError, warn_input
from sips_lit.frames.source import Source
from sips_lit.pairs.sampler import FixedPairs, SourcePair, SourceSampler, pair_name, read_pair
from sips_lit.train.augment import Augmentation
from sips_lit.types import InlierCheck

NOTHING = np.zeros((0, 0), np.uint8)
TRIES = 20
TRUSTED = 50  # pairs left out before their share counts


@dataclass(slots=True)
class TrainingPairs:
    """Pair number i of a run, the same whichever worker makes it and after whichever interruption.

    In place of a pair that can't be read another is drawn, until one can.
    """

    sources: Sequence[Source]
    sampler: SourceSampler
    default: InlierCheck
    augmentation: Augmentation | None
    length: int

    def __len__(self) -> int:
        return self.length

    def name(self, index: int) -> str:
        """What pair ``index`` is called, if it can be read."""
        at, choice = self.sampler.draw(0, index)
        return pair_name(self.sources[at].sequences[choice.sequence], choice.index0, choice.index1)

    def __getitem__(self, index: int) -> SourcePair:
        """Pair ``index``; raises BadInputError when `TRIES` pairs in a row can't be read."""
        skipped: list[str] = []
        for attempt in range(TRIES):
            try:
                at, choice = self.sampler.draw(
                    attempt, index
                )  # a run is one long epoch: the sampler's epoch counts tries
                sequence, check = self.sources[at].sequences[choice.sequence], self.sources[at].inliers or self.default
                pair = read_pair(sequence, choice.index0, choice.index1, check.uses_frames, check.uses_depth)
            except BadInputError as error:
                skipped.append(str(error))
                continue
            if self.augmentation is not None:
                planar = not (check.uses_frames or check.uses_depth)
                generator = np.random.default_rng([self.sampler.seed, 0, index, 1])
                pair = self.augmentation(pair, generator, planar)
            return SourcePair(pair, at, tuple(skipped))
        raise BadInputError(f"{TRIES} training pairs in a row can't be read; the first: {skipped[0]}")


class SkippedItems:
    """Counts what a run left out, of its pairs or frames, which ``what`` names.

    Warns of the first, and refuses to go on with less than half of them.
    """

    def __init__(self, what: str = "training pair") -> None:
        self.what, self.count, self.first = what, 0, ""

    def add(self, reasons: Sequence[str], taken: int) -> None:
        """Counts items left out, one reason each, before item number ``taken`` (from 1) of a run.

        Raises BadInputError when more than half of all items can't be read.
        """
        if reasons and not self.count:
            self.first = reasons[0]
            warn_input(f"a {self.what} is left out, and others may be: {self.first}")
        self.count += len(reasons)
        if self.count >= TRUSTED and self.count > taken:
            raise BadInputError(
                f"{self.count} of the first {self.count + taken} {self.what}s can't be read; the first: {self.first}"
            )

    def __str__(self) -> str:
        return f"{self.count} {self.what}s were left out; the first: {self.first}"

    def state_dict(self) -> dict[str, Any]:
        """Plain values, as a checkpoint may hold."""
        return {"count": self.count, "first": self.first}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Goes on counting."""
        self.count, self.first = state["count"], state["first"]


class PackedPairs(Dataset[dict[str, Any] | BadInputError]):
    """The pairs of another dataset as they pass between processes: all images of a pair in one tensor.

    Tensors go through shared memory, arrays through a pipe. A pair that can't be read passes as its error, since an
    exception in a worker would lose its message in a traceback.
    """

    what = "training pair"

    def __init__(self, pairs: TrainingPairs | FixedPairs) -> None:
        self.pairs = pairs

    def __len__(self) -> int:
        return len(self.pairs)

    def name(self, index: int) -> str:
        """What pair ``index`` is called, without reading it."""
        return self.pairs.name(index)

    def __getitem__(self, index: int) -> dict[str, Any] | BadInputError:
        """Pair ``index``, for `unpack`, with the seconds that it took."""
        start = time.perf_counter()
        try:
            return {**pack(self.pairs[index]), "seconds": time.perf_counter() - start}
        except BadInputError as error:
            return error
        except OSError as error:
            return BadInputError(
                f"{self.name(index)} can't be read: {error.filename or 'its files'}: {error.strerror or error}"
            )


def pack(item: SourcePair) -> dict[str, Any]:
    """The pair with all its images in one flat tensor."""
    images = [*item.pair.frames, item.pair.image0, item.pair.image1]
    return {
        "item": replace(item, pair=replace(item.pair, frames=(), image0=NOTHING, image1=NOTHING)),
        "shapes": [image.shape for image in images],
        "pixels": torch.from_numpy(np.concatenate([image.ravel() for image in images])),
    }


def unpack(packed: Mapping[str, Any] | BadInputError) -> SourcePair:
    """What was packed; the images are views of the tensor. Raises the error that came in place of a pair."""
    if isinstance(packed, BadInputError):
        raise packed
    shapes: list[tuple[int, int]] = packed["shapes"]
    borders = np.cumsum([height * width for height, width in shapes])[:-1]
    parts = np.split(packed["pixels"].numpy(), borders)
    *frames, image0, image1 = (part.reshape(shape) for part, shape in zip(parts, shapes, strict=True))
    item: SourcePair = packed["item"]
    return replace(item, pair=replace(item.pair, frames=tuple(frames), image0=image0, image1=image1))

"""Training and validation pairs as datasets: decoding, sampling and augmentation, run in DataLoader workers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset

from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source
from sips_lit.tracking.overlap import OverlapIndex
from sips_lit.tracking.pairs import PairChoice, PairSampler, read_pair
from sips_lit.train.augment import Augmentation
from sips_lit.types import FramePair, GreyImage, InlierCheck


@dataclass(frozen=True, slots=True)
class SourcePair:
    """A pair and the position of its source in the list of sources."""

    pair: FramePair
    source: int


class SourceSampler:
    """Draws a source by weight, then a pair of it: a pure function of (seed, epoch, index).

    ``indexes`` are the overlap indexes of all sequences of all sources, in their order. Raises BadInputError when a source
    has no pair with this overlap.
    """

    def __init__(self, sources: Sequence[Source], indexes: Sequence[OverlapIndex], overlap: float, seed: int) -> None:
        self.seed = seed
        self.samplers = []
        taken = 0
        for source in sources:
            own = indexes[taken : taken + len(source.sequences)]
            names = [sequence.name for sequence in source.sequences[:3]]
            self.samplers.append(PairSampler(own, overlap, seed, names=names))
            taken += len(source.sequences)
        weights = np.cumsum([source.weight for source in sources])
        self.cumulative_weight = weights / weights[-1]

    def draw(self, epoch: int, index: int) -> tuple[int, PairChoice]:
        """Position of the source, and the pair."""
        # the last number sets this stream apart from the pair's own; a 0 would not: numpy ignores trailing zeros
        generator = np.random.default_rng([self.seed, epoch, index, 2])
        at = int(np.searchsorted(self.cumulative_weight, generator.random(), side="right"))
        return at, self.samplers[at].draw(epoch, index)

    def fixed(self, count: int) -> list[tuple[int, PairChoice]]:
        """``count`` different pairs (fewer if there are not so many), always the same for a seed."""
        chosen: dict[tuple[int, PairChoice], None] = {}
        for index in range(20 * count):  # draws repeat: stop looking after many
            chosen[self.draw(0, index)] = None
            if len(chosen) == count:
                break
        return list(chosen)


class TrainingPairs(Dataset[SourcePair]):
    """Pair number i of a run, the same whichever worker makes it and after whichever interruption."""

    def __init__(
        self,
        sources: Sequence[Source],
        sampler: SourceSampler,
        default: InlierCheck,
        augmentation: Augmentation | None,
        length: int,
    ) -> None:
        self.sources, self.sampler, self.augmentation, self.length = list(sources), sampler, augmentation, length
        self.uses_frames = [(source.inliers or default).uses_frames for source in sources]

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, index: int) -> SourcePair:
        """Pair ``index``; raises BadInputError when one of its frames can't be read."""
        at, choice = self.sampler.draw(0, index)
        pair = read_pair(
            self.sources[at].sequences[choice.sequence], choice.index0, choice.index1, self.uses_frames[at]
        )
        if self.augmentation is not None:
            pair = self.augmentation(pair, np.random.default_rng([self.sampler.seed, 0, index, 1]))
        return SourcePair(pair, at)


class FixedPairs(Dataset[SourcePair]):
    """The same pairs every time, unaugmented, for validation and evaluation."""

    def __init__(
        self, sources: Sequence[Source], choices: Sequence[tuple[int, PairChoice]], default: InlierCheck
    ) -> None:
        self.sources, self.choices = list(sources), list(choices)
        self.uses_frames = [(source.inliers or default).uses_frames for source in sources]

    def __len__(self) -> int:
        return len(self.choices)

    def __getitem__(self, index: int) -> SourcePair:
        """Pair ``index``; raises BadInputError when one of its frames can't be read."""
        at, choice = self.choices[index]
        sequence = self.sources[at].sequences[choice.sequence]
        return SourcePair(read_pair(sequence, choice.index0, choice.index1, self.uses_frames[at]), at)


class PackedPairs(Dataset[dict[str, Any] | BadInputError]):
    """The pairs of another dataset as they pass between processes: all images of a pair in one tensor.

    Tensors go through shared memory, arrays through a pipe. A pair that can't be read passes as its error, since an
    exception in a worker would lose its message in a traceback.
    """

    def __init__(self, pairs: TrainingPairs | FixedPairs) -> None:
        self.pairs = pairs

    def __len__(self) -> int:
        return len(self.pairs)

    def __getitem__(self, index: int) -> dict[str, Any] | BadInputError:
        """Pair ``index``, for `unpack`."""
        try:
            return pack(self.pairs[index])
        except BadInputError as error:
            return error


def pack(item: SourcePair) -> dict[str, Any]:
    """The pair with all its images in one flat tensor."""
    images = [*item.pair.frames, item.pair.image0, item.pair.image1]
    return {
        "item": SourcePair(_with_images(item.pair, []), item.source),
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
    images = [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
    item: SourcePair = packed["item"]
    return SourcePair(_with_images(item.pair, images), item.source)


def _with_images(pair: FramePair, images: list[GreyImage]) -> FramePair:
    """The same pair with other images: its frames, then image 0 and image 1; or without any."""
    nothing = np.zeros((0, 0), np.uint8)
    *frames, image0, image1 = images or [nothing, nothing]
    return replace(pair, frames=tuple(frames), image0=image0, image1=image1)

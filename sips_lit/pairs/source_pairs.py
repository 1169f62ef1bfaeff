"""Pairs of several sources: drawn by weight, and fixed sets of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from torch.utils.data import Dataset

from sips_lit.frames.source import Source
from sips_lit.pairs.overlap import OverlapIndex
from sips_lit.pairs.sampler import PairChoice, PairSampler, read_pair
from sips_lit.types import FramePair, InlierCheck


@dataclass(frozen=True, slots=True)
class SourcePair:
    """A pair and the position of its source in the list of sources.

    ``skipped`` tells why pairs that were drawn in its place before could not be read.
    """

    pair: FramePair
    source: int
    skipped: tuple[str, ...] = ()


class SourceSampler:
    """Draws a source by weight, then a pair of it: a pure function of (seed, epoch, index).

    ``indexes`` are the overlap indexes of all sequences of all sources, in their order. Raises BadInputError when a source
    has no pair with this overlap.
    """

    def __init__(self, sources: Sequence[Source], indexes: Sequence[OverlapIndex], overlap: float, seed: int) -> None:
        self.seed, self.indexes = seed, list(indexes)
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

    def fixed(
        self, count: int, usable: Callable[[int, PairChoice], bool] = lambda source, choice: True
    ) -> list[tuple[int, PairChoice]]:
        """``count`` different ``usable`` pairs (fewer if there are not so many), always the same for a seed."""
        chosen: dict[tuple[int, PairChoice], bool] = {}
        for index in range(20 * count):  # draws repeat: stop looking after many
            drawn = self.draw(0, index)
            if drawn not in chosen:
                chosen[drawn] = usable(*drawn)
            if sum(chosen.values()) == count:
                break
        return [drawn for drawn, used in chosen.items() if used]


class FixedPairs(Dataset[SourcePair]):
    """The same pairs every time, unaugmented, for validation and evaluation."""

    def __init__(
        self, sources: Sequence[Source], choices: Sequence[tuple[int, PairChoice]], default: InlierCheck
    ) -> None:
        self.sources, self.choices = list(sources), list(choices)
        self.checks = [source.inliers or default for source in sources]

    def __len__(self) -> int:
        return len(self.choices)

    def __getitem__(self, index: int) -> SourcePair:
        """Pair ``index``; raises BadInputError when one of its frames can't be read."""
        at, choice = self.choices[index]
        sequence = self.sources[at].sequences[choice.sequence]
        check = self.checks[at]
        return SourcePair(read_pair(sequence, choice.index0, choice.index1, check.uses_frames, check.uses_depth), at)

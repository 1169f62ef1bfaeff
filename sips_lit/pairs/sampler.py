"""Frame pairs: drawn at random by source and overlap (paper, pair selection), and read with all frames between."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source
from sips_lit.pairs.overlap import OverlapIndex
from sips_lit.pairs.recent import Recent
from sips_lit.pairs.stored import PairTable
from sips_lit.progress import progress
from sips_lit.types import FramePair, ImageSequence, InlierCheck, ViewGeometry

HELD: Final = 1 << 24
"""Bytes of numbers of frames with partners that a sampler holds."""


@dataclass(frozen=True, slots=True)
class PairChoice:
    """Two frames of the sequence at position ``sequence`` in a list."""

    sequence: int
    index0: int
    index1: int


@dataclass(frozen=True, slots=True)
class SourcePair:
    """A pair and the position of its source in the list of sources.

    ``skipped`` tells why pairs that were drawn in its place before could not be read.
    """

    pair: FramePair
    source: int
    skipped: tuple[str, ...] = ()


class PairSampler:
    """Draws a random frame of some sequences and a random later one with enough overlap, less than ``below``, in any order.

    Every frame that has such a partner is equally likely. ``spread`` says how evenly its partners are drawn over their
    difficulties (`OverlapIndex.difficulty`): with 0 each partner is equally likely (paper), with 1 each difficulty, so that
    a slow camera gives more than neighbours that look alike. A draw is a pure function of (seed, epoch, index). Raises
    BadInputError when no pair reaches the overlap; ``names`` tells the user where.
    """

    def __init__(
        self,
        indexes: Sequence[PairTable],
        overlap: float,
        seed: int,
        names: Sequence[str] = (),
        below: float = math.inf,
        spread: float = 0.0,
    ) -> None:
        self.seed, self.range, self.spread, self.indexes = seed, (overlap, below), spread, list(indexes)
        counts = [
            index.count(*self.range)
            for index in progress(self.indexes, desc="counting pairs", unit="sequence", total=len(self.indexes))
        ]
        self._ends = np.cumsum([count.frames for count in counts], dtype=np.int64)  # of all frames with a partner
        self.pair_count = sum(count.pairs for count in counts)
        self._eligible: Recent[NDArray[np.int64]] = Recent(HELD, attrgetter("nbytes"))
        if not self.pair_count:
            best = max(
                (float(i.overlap(f).max(initial=0)) for i in map(_read, indexes) for f in range(len(i))), default=0
            )
            raise BadInputError(
                f"no two frames of {', '.join(names) or 'the data'} overlap by {overlap:g}"
                f"{f' and less than {below:g}' if below < math.inf else ''}: the most found is {best:.2f}; "
                "give more or closer frames of one moving camera, in temporal order, or ask for less overlap"
            )

    def draw(self, epoch: int, index: int) -> PairChoice:
        """Draw number ``index`` of an epoch."""
        generator = np.random.default_rng([self.seed, epoch, index])
        at = int(generator.integers(self._ends[-1]))
        sequence = int(np.searchsorted(self._ends, at, side="right"))
        table, eligible = self.indexes[sequence].read(), self._frames_of(sequence)
        first = int(eligible[at - int(self._ends[sequence])])  # counted from the end of those of the sequence
        partners = table.partners(first, *self.range)
        of_partners = table.difficulty(first)[partners - first - 1]
        _, kind, count = np.unique(of_partners, return_inverse=True, return_counts=True)
        weight = np.cumsum(count[kind] ** -float(self.spread))
        second = int(partners[np.searchsorted(weight, generator.random() * weight[-1], side="right")])
        if generator.random() < 0.5:
            first, second = second, first
        return PairChoice(sequence, first, second)

    def all_pairs(self) -> Iterator[PairChoice]:
        """Each pair once, the earlier frame first."""
        for sequence, index in enumerate(map(_read, self.indexes)):
            for first in self._frames_of(sequence).tolist():
                for second in index.partners(first, *self.range).tolist():
                    yield PairChoice(sequence, first, second)

    def _frames_of(self, sequence: int) -> NDArray[np.int64]:
        """Frames of a sequence that have partners."""
        return self._eligible.get(sequence, lambda: np.flatnonzero(self.indexes[sequence].read().reach(*self.range)))


def _read(index: PairTable) -> OverlapIndex:
    return index.read()


class SourceSampler:
    """Draws a source by weight, then a pair of it: a pure function of (seed, epoch, index).

    ``indexes`` are the overlap indexes of all sequences of all sources, in their order. Raises BadInputError when a source
    has no pair with this overlap.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        indexes: Sequence[PairTable],
        overlap: float,
        seed: int,
        below: float = math.inf,
        spread: float = 0.0,
    ) -> None:
        self.seed, self.indexes = seed, list(indexes)
        self.samplers = []
        remaining = iter(indexes)
        for source in sources:
            own = list(itertools.islice(remaining, len(source.sequences)))
            names = [sequence.name for sequence in source.sequences[:3]]
            self.samplers.append(PairSampler(own, overlap, seed, names, below, spread))
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
        """``count`` different ``usable`` pairs (fewer if there are not so many), always the same for a seed.

        Frames i and j are one pair, whichever comes first in it.
        """
        asked: set[tuple[int, int, int, int]] = set()
        chosen: list[tuple[int, PairChoice]] = []
        draws = 20 * count  # they repeat: after so many the pairs that are left are looked for one by one
        drawn = (self.draw(0, index) for index in range(draws))
        there_are = sum(sampler.pair_count for sampler in self.samplers)
        rest = self._all() if there_are <= draws else ()
        for at, choice in itertools.chain(drawn, rest):
            if len(chosen) == count or len(asked) == there_are:
                break
            pair = at, choice.sequence, min(choice.index0, choice.index1), max(choice.index0, choice.index1)
            if pair not in asked:
                asked.add(pair)
                chosen += [(at, choice)] if usable(at, choice) else []
        return chosen

    def _all(self) -> Iterator[tuple[int, PairChoice]]:
        return ((at, choice) for at, sampler in enumerate(self.samplers) for choice in sampler.all_pairs())


@dataclass(frozen=True, slots=True)
class FixedPairs:
    """The same pairs every time, unaugmented, for validation and evaluation."""

    sources: Sequence[Source]
    choices: Sequence[tuple[int, PairChoice]]
    default: InlierCheck

    def __len__(self) -> int:
        return len(self.choices)

    def name(self, index: int) -> str:
        """What pair ``index`` is called."""
        at, choice = self.choices[index]
        return pair_name(self.sources[at].sequences[choice.sequence], choice.index0, choice.index1)

    def size(self, index: int) -> str:
        """Width and height of the first image of pair ``index``. Raises BadInputError when it can't be read."""
        at, choice = self.choices[index]
        height, width = self.sources[at].sequences[choice.sequence].frame(choice.index0).shape
        return f"{width}x{height}"

    def __getitem__(self, index: int) -> SourcePair:
        """Pair ``index``; raises BadInputError when one of its frames can't be read."""
        at, choice = self.choices[index]
        sequence, check = self.sources[at].sequences[choice.sequence], self.sources[at].inliers or self.default
        return SourcePair(read_pair(sequence, choice.index0, choice.index1, check.uses_frames, check.uses_depth), at)


def pair_name(sequence: ImageSequence, index0: int, index1: int) -> str:
    """What the pair of these frames is called."""
    return f"{sequence.name}:{index0}-{index1}"


def read_pair(sequence: ImageSequence, index0: int, index1: int, between: bool = True, depth: bool = True) -> FramePair:
    """Frames ``index0`` and ``index1`` and what is known about them.

    Without ``between`` the frames between are not read, without ``depth`` neither depth maps nor right images. Raises
    BadInputError where frames between are asked for and the order of the frames means nothing.
    """
    if between and not sequence.temporal:
        raise BadInputError(
            f"the images of {sequence.name} are in no order, so points can't be tracked through those between two of them: "
            "choose another source of inliers, such as inliers=homography"
        )
    step = 1 if index1 > index0 else -1
    indices = range(index0, index1 + step, step) if between else (index0, index1)
    name, frames = pair_name(sequence, index0, index1), tuple(sequence.frame(index) for index in indices)
    homography, geometry = sequence.homography(index0, index1), _geometry(sequence, index0, index1, depth)
    return FramePair(name, index0, index1, frames, frames[0], frames[-1], homography, geometry)


def _geometry(sequence: ImageSequence, index0: int, index1: int, depth: bool) -> ViewGeometry | None:
    camera0, camera1 = sequence.camera(index0), sequence.camera(index1)
    if camera0 is None or camera1 is None:
        return None
    pose0, pose1 = sequence.pose(index0), sequence.pose(index1)
    T_1_0 = None if pose0 is None or pose1 is None else np.linalg.inv(pose1) @ pose0
    if not depth:
        return ViewGeometry(T_1_0, camera0, camera1, None, None)
    depth0, depth1 = sequence.depth(index0), sequence.depth(index1)
    right0 = sequence.right(index0) if depth0 is None else None
    right1 = sequence.right(index1) if depth1 is None else None
    baseline = sequence.baseline() if right0 is not None or right1 is not None else None
    return ViewGeometry(T_1_0, camera0, camera1, depth0, depth1, right0, right1, baseline)

"""Frame pairs: drawn at random by overlap (paper, pair selection), and read with all frames between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sips_lit.errors import BadInputError
from sips_lit.tracking.overlap import OverlapIndex
from sips_lit.types import FramePair, ImageSequence, ViewGeometry


@dataclass(frozen=True, slots=True)
class PairChoice:
    """Two frames of the sequence at position ``sequence`` in a list."""

    sequence: int
    index0: int
    index1: int


class PairSampler:
    """Draws a random frame and a random later frame with enough overlap, in random order.

    ``weights``: relative probability of each sequence's frames (default: every frame of every sequence counts alike).
    A draw is a pure function of (seed, epoch, index). Raises BadInputError when no pair reaches the overlap.
    """

    def __init__(
        self,
        indexes: Sequence[OverlapIndex],
        overlap: float,
        seed: int,
        weights: Sequence[float] | None = None,
        names: Sequence[str] = (),
    ) -> None:
        reaches = [index.reach(overlap) for index in indexes]
        eligible = [np.flatnonzero(reach) for reach in reaches]
        weights = [1.0] * len(indexes) if weights is None else list(weights)
        self.seed = seed
        self._sequence = np.repeat(np.arange(len(indexes)), [len(e) for e in eligible])
        self._frame = np.concatenate([*eligible, np.zeros(0, np.int64)])
        self._reach = np.concatenate([*(r[e] for r, e in zip(reaches, eligible, strict=True)), np.zeros(0, np.int64)])
        cumulative = np.cumsum(np.asarray(weights, np.float64)[self._sequence])
        if not len(cumulative) or cumulative[-1] <= 0:
            best = max((float(index.overlap(i).max(initial=0)) for index in indexes for i in range(len(index))), default=0)
            where = f" in {', '.join(names)}" if names else ""
            raise BadInputError(
                f"no two frames{where} overlap by {overlap:g}: the most found is {best:.2f}; give more or closer frames "
                "of one moving camera, in temporal order, or ask for less overlap"
            )
        self._cumulative = cumulative / cumulative[-1]

    def draw(self, epoch: int, index: int) -> PairChoice:
        """Draw number ``index`` of an epoch."""
        generator = np.random.default_rng([self.seed, epoch, index])
        at = int(np.searchsorted(self._cumulative, generator.random(), side="right"))
        first = int(self._frame[at])
        second = first + int(generator.integers(1, self._reach[at] + 1))
        if generator.random() < 0.5:
            first, second = second, first
        return PairChoice(int(self._sequence[at]), first, second)

    def fixed(self, count: int) -> list[PairChoice]:
        """``count`` different pairs (fewer if there are not so many), always the same for a seed: for evaluation."""
        chosen: dict[PairChoice, None] = {}
        for index in range(20 * count):  # with replacement, so pairs repeat: stop looking after many draws
            chosen[self.draw(0, index)] = None
            if len(chosen) == count:
                break
        return list(chosen)


def read_pair(sequence: ImageSequence, index0: int, index1: int, between: bool = True) -> FramePair:
    """Frames ``index0`` and ``index1`` and what is known about them; without ``between`` the frames between are not read."""
    step = 1 if index1 > index0 else -1
    indices = range(index0, index1 + step, step) if between else (index0, index1)
    frames = tuple(sequence.frame(index) for index in indices)
    return FramePair(
        name=f"{sequence.name}:{index0}-{index1}",
        index0=index0,
        index1=index1,
        frames=frames,
        image0=frames[0],
        image1=frames[-1],
        homography=sequence.homography(index0, index1),
        geometry=_geometry(sequence, index0, index1),
    )


def _geometry(sequence: ImageSequence, index0: int, index1: int) -> ViewGeometry | None:
    pose0, pose1 = sequence.pose(index0), sequence.pose(index1)
    camera0, camera1 = sequence.camera(index0), sequence.camera(index1)
    depth0 = sequence.depth(index0)
    if pose0 is None or pose1 is None or camera0 is None or camera1 is None or depth0 is None:
        return None
    return ViewGeometry(np.linalg.inv(pose1) @ pose0, camera0, camera1, depth0, sequence.depth(index1))

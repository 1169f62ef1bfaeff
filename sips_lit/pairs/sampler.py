"""Frame pairs: drawn at random by overlap (paper, pair selection), and read with all frames between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sips_lit.errors import BadInputError
from sips_lit.pairs.overlap import OverlapIndex
from sips_lit.types import FramePair, ImageSequence, ViewGeometry


@dataclass(frozen=True, slots=True)
class PairChoice:
    """Two frames of the sequence at position ``sequence`` in a list."""

    sequence: int
    index0: int
    index1: int


class PairSampler:
    """Draws a random frame of some sequences and a random later frame with enough overlap, in random order.

    Every frame that has such a partner is equally likely. A draw is a pure function of (seed, epoch, index). Raises
    BadInputError when no pair reaches the overlap; ``names`` tells the user where.
    """

    def __init__(self, indexes: Sequence[OverlapIndex], overlap: float, seed: int, names: Sequence[str] = ()) -> None:
        reaches = [index.reach(overlap) for index in indexes]
        eligible = [np.flatnonzero(reach) for reach in reaches]
        self.seed, self.overlap, self.indexes = seed, overlap, list(indexes)
        self._sequence = np.repeat(np.arange(len(indexes)), [len(e) for e in eligible])
        self._frame = np.concatenate([*eligible, np.zeros(0, np.int64)])
        self._reach = np.concatenate([*(r[e] for r, e in zip(reaches, eligible, strict=True)), np.zeros(0, np.int64)])
        if not len(self._frame):
            best = max(
                (float(index.overlap(i).max(initial=0)) for index in indexes for i in range(len(index))), default=0
            )
            raise BadInputError(
                f"no two frames of {', '.join(names) or 'the data'} overlap by {overlap:g}: the most found is {best:.2f}; "
                "give more or closer frames of one moving camera, in temporal order, or ask for less overlap"
            )

    def draw(self, epoch: int, index: int) -> PairChoice:
        """Draw number ``index`` of an epoch."""
        generator = np.random.default_rng([self.seed, epoch, index])
        at = int(generator.integers(len(self._frame)))
        first = int(self._frame[at])
        which = int(generator.integers(1, self._reach[at] + 1)) - 1
        sequence = int(self._sequence[at])
        second = int(self.indexes[sequence].partners(first, self.overlap)[which])
        if generator.random() < 0.5:
            first, second = second, first
        return PairChoice(sequence, first, second)


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
    frames = tuple(sequence.frame(index) for index in indices)
    return FramePair(
        name=f"{sequence.name}:{index0}-{index1}",
        index0=index0,
        index1=index1,
        frames=frames,
        image0=frames[0],
        image1=frames[-1],
        homography=sequence.homography(index0, index1),
        geometry=_geometry(sequence, index0, index1, depth),
    )


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

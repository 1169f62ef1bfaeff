"""How difficult the pairs are that a sequence gives: how they spread over overlap, distance, turn and zoom."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.pairs.overlap import OverlapIndex

TRAINING: Final = 0.1
"""The least overlap of training pairs, as configured (paper: 0.3)."""
CLASSES: Final = np.array([TRAINING, 0.2, 0.4, 0.6, 0.8])
"""Where classes of overlap begin, as in `OverlapIndex.difficulty`."""
ALIKE: Final = 0.9
"""A sequence with more neighbours among its pairs teaches little else."""


@dataclass(frozen=True, slots=True)
class PairSpread:
    """The pairs of a sequence with enough overlap for training.

    ``classes`` (5,): how many are in each of `CLASSES`; ``neighbours``: the share of pairs of neighbouring frames, NaN where
    the order of the frames means nothing or there is no pair; ``motion`` (3, 101): percentiles 0 to 100 of the median
    displacement in pixels, of the turn in degrees, and of the zoom as a factor >= 1, NaN without a pair.
    """

    classes: NDArray[np.int64]
    neighbours: float
    motion: NDArray[np.float64]

    @property
    def pairs(self) -> int:
        """How many pairs there are."""
        return int(self.classes.sum())

    @property
    def only_neighbours(self) -> bool:
        """Whether hardly any pair is of other frames than neighbours."""
        return self.neighbours >= ALIKE


def pair_spread(index: OverlapIndex, temporal: bool = True) -> PairSpread:
    """The spread of the pairs of a sequence; ``temporal``: whether the order of its frames means anything."""
    row = np.repeat(np.arange(len(index)), np.diff(index.offsets))
    overlap = index.survivors / np.maximum(1, index.points[row])
    enough = overlap >= TRAINING
    if not enough.any():
        return PairSpread(np.zeros(len(CLASSES), np.int64), float("nan"), np.full((3, 101), np.nan))
    gap = np.arange(len(row)) - index.offsets[row] + 1
    moved, turn, zoom = np.abs(index.motion[enough].astype(np.float64).T)
    return PairSpread(
        np.bincount(np.searchsorted(CLASSES, overlap[enough], side="right") - 1, minlength=len(CLASSES)),
        float((gap[enough] == 1).mean()) if temporal else float("nan"),
        np.percentile(np.stack([moved, turn, 2**zoom]), np.arange(101), axis=1).T,
    )

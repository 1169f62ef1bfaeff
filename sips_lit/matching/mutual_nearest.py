"""Mutual nearest neighbours in descriptor space, for one budget of points or for every budget at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import Features, FloatArray, Matches

FOREVER: Final = 2**31 - 1
"""The `last` budget of a match that no further point can break."""


def distances(features0: Features, features1: Features) -> NDArray[np.float32]:
    """(N0, N1) distances between the descriptors: squared L2, or exact Hamming in bits for packed uint8 ones.

    Raises ValueError when the two sides are not comparable: different norms or different lengths.
    """
    norms = {features0.norm, features1.norm}
    if len(norms) > 1:
        raise ValueError(f"descriptors of different norms cannot be compared: {features0.norm} and {features1.norm}")
    if features0.descriptors.shape[1] != features1.descriptors.shape[1]:
        shapes = f"{features0.descriptors.shape[1]} and {features1.descriptors.shape[1]}"
        raise ValueError(f"descriptors of different lengths cannot be compared: {shapes}")
    vectors0, vectors1 = _vectors(features0), _vectors(features1)
    squares0 = np.einsum("nd,nd->n", vectors0, vectors0)
    squares1 = np.einsum("nd,nd->n", vectors1, vectors1)
    result: NDArray[np.float32] = squares0[:, None] + squares1
    result -= 2 * (vectors0 @ vectors1.T)
    return np.maximum(result, 0, out=result)  # rounding may make the distance of equal descriptors negative


def _vectors(features: Features) -> NDArray[np.float32]:
    """Float vectors whose squared L2 distance is the norm's: of bits, it is the number of those that differ."""
    if features.norm == "hamming":
        return np.unpackbits(features.descriptors.astype(np.uint8, copy=False), axis=1).astype(np.float32)
    return features.descriptors.astype(np.float32, copy=False)


def mutual_nearest(distances: FloatArray) -> Matches:
    """The pairs that are each other's nearest neighbour in the (N0, N1) matrix, by ascending `index0`.

    Of equally near neighbours the one of lowest index counts, so a point has one match at most.
    """
    if distances.size == 0:
        return Matches(np.zeros(0, np.int64), np.zeros(0, np.int64))
    nearest1 = distances.argmin(axis=1)
    nearest0 = distances.argmin(axis=0)
    index0 = np.flatnonzero(nearest0[nearest1] == np.arange(len(nearest1)))
    return Matches(index0, nearest1[index0])


@dataclass(frozen=True, slots=True)
class MutualLifetimes:
    """The mutual matches of every budget: pair m is one for the best n points exactly while first <= n <= last.

    ``index0``, ``index1``, ``first`` and ``last`` are (M,) int64, in the order of birth; ``last`` is `FOREVER` for a
    pair that survives all points of both images. No pair occurs twice.
    """

    index0: NDArray[np.int64]
    index1: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]

    @classmethod
    def of_all(cls, matches: Matches) -> MutualLifetimes:
        """The matches of all points (not of a budget): each lives from the first budget with both its points on."""
        first = np.maximum(matches.index0, matches.index1) + 1
        return cls(matches.index0, matches.index1, first, np.full(len(first), FOREVER, np.int64))

    def __len__(self) -> int:
        return len(self.index0)

    def __getitem__(self, rows: NDArray[Any]) -> MutualLifetimes:
        """Some of the pairs, by a mask or by positions."""
        return MutualLifetimes(self.index0[rows], self.index1[rows], self.first[rows], self.last[rows])

    def __add__(self, other: MutualLifetimes) -> MutualLifetimes:
        """These pairs, then others."""
        columns = ((getattr(self, name), getattr(other, name)) for name in self.__slots__)
        return MutualLifetimes(*map(np.concatenate, columns))

    @property
    def matches(self) -> Matches:
        """Every pair that is mutual at some budget, in the order of this record: what an inlier check is asked."""
        return Matches(self.index0, self.index1)

    def at(self, n: int) -> Matches:
        """The matches between the best ``n`` points of both images, as `mutual_nearest` of the cropped matrix."""
        alive = np.flatnonzero((self.first <= n) & (n <= self.last))
        alive = alive[np.argsort(self.index0[alive])]
        return Matches(self.index0[alive], self.index1[alive])


def mutual_nearest_lifetimes(distances: FloatArray) -> MutualLifetimes:
    """The mutual matches of every crop of (N0, N1) ``distances`` to ``[:n, :n]``, in one pass.

    A pair (i, j) first exists in the crop n = m + 1, m = max(i, j). It is mutual there only if the newly come row m and
    column m bear it, since a pair that was not the nearest among fewer points never becomes it among more. Row m has
    one nearest column and column m one nearest row, so two pairs at most are born with each n. A pair dies for good
    with the first strictly nearer partner of either point (equally near ones come later in the order, so they lose).
    """
    rows, columns = distances.shape
    if distances.size == 0:
        none = np.zeros(0, np.int64)
        return MutualLifetimes(none, none, none, none)
    row_least = np.minimum.accumulate(distances, axis=1)
    column_least = np.minimum.accumulate(distances, axis=0)
    row, column = np.arange(rows), np.arange(columns)
    later_column = column[None, :] > row[:, None]
    later_row = row[:, None] > column[None, :]

    # Born with row m: its nearest among the columns so far, if row m is nearer to it than all rows before.
    nearest_column = np.where(later_column, np.inf, distances).argmin(axis=1)
    born = _is_new_least(column_least, row, nearest_column)
    by_row = row[born], nearest_column[born]
    # Born with column m, likewise; the pair (m, m) was counted with its row.
    nearest_row = np.where(later_row, np.inf, distances).argmin(axis=0)
    born = _is_new_least(row_least.T, column, nearest_row) & (nearest_row != column)
    by_column = nearest_row[born], column[born]

    index0 = np.concatenate([by_row[0], by_column[0]])
    index1 = np.concatenate([by_row[1], by_column[1]])
    first = np.maximum(index0, index1) + 1
    distance = distances[index0, index1][:, None]
    # A running minimum only falls, so the steps at which it is still the pair's own distance are its lifetime.
    until_column = np.count_nonzero(row_least[index0] >= distance, axis=1)
    until_row = np.count_nonzero(column_least.T[index1] >= distance, axis=1)
    last = np.minimum(
        np.where(until_column == columns, FOREVER, until_column), np.where(until_row == rows, FOREVER, until_row)
    )
    order = np.lexsort((index1, index0, first))
    return MutualLifetimes(index0[order], index1[order], first[order], last[order])


def _is_new_least(least: FloatArray, step: NDArray[np.int64], lane: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether the running minimum ``least[:, lane]`` falls at ``step``; at step 0 it always does."""
    before = least[np.maximum(step - 1, 0), lane]
    fallen: NDArray[np.bool_] = (step == 0) | (least[step, lane] < before)
    return fallen

"""Overlap indexes from rows of survivors, and back, for the tests."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sips_lit.pairs.overlap import OverlapIndex


def index_of(
    rows: Sequence[Sequence[int]], points: Any = 10, motion: Any = None, unreadable: Mapping[int, str] | None = None
) -> OverlapIndex:
    """``points``: of each frame, or of all alike; ``motion`` (P, 3): of all pairs, row by row, else none."""
    survivors = np.array([count for row in rows for count in row], np.uint16)
    return OverlapIndex(
        survivors,
        np.zeros((len(survivors), 3), np.float16) if motion is None else np.asarray(motion, np.float16),
        np.cumsum([0, *map(len, rows)]),
        np.broadcast_to(points, len(rows)).astype(np.int64),
        unreadable or {},
    )


def all_overlap(length: int) -> OverlapIndex:
    """Every frame sees all later ones."""
    return index_of([[9] * (length - 1 - frame) for frame in range(length)], 9)


def rows_of(index: OverlapIndex) -> list[list[int]]:
    """Survivors of each frame in the later ones."""
    return [index.survivors[a:b].tolist() for a, b in zip(index.offsets[:-1], index.offsets[1:], strict=True)]

"""Coverage: do budgets that promise k inliers with a probability hold them as often, and with how many points?

Coverage of a promise and its cost, as for prediction intervals: a promise that is kept too often costs points. The cost is
compared with the best fixed number of points that holds k inliers as often.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Coverage:
    """Of a promise ``asked``: how often it was kept, ``observed``, with ``points`` in the mean, over ``promised`` images.

    ``fixed``: the smallest fixed number of points that holds k inliers in at least as many of the same images; None where
    none does. ``out_of_reach``: images where even all points promise less; nothing else counts them. Without any promise
    ``observed`` and ``points`` are NaN.
    """

    asked: float
    observed: float
    points: float
    fixed: int | None
    promised: int
    out_of_reach: int


def coverage(asked: float, budgets: Sequence[int | None], inliers: NDArray[np.int64], k: int) -> Coverage:
    """Coverage of I images.

    ``budgets`` (I,): the points that promise k inliers in each, None where none do; ``inliers`` (I, N + 1): how many there
    are among the n best points of an image, n = 0..N, where more than N points are as N.
    """
    reached = np.array([budget is not None for budget in budgets], bool)
    chosen = np.array([budget for budget in budgets if budget is not None], np.int64)
    if not len(chosen):
        return Coverage(asked, math.nan, math.nan, None, 0, len(budgets))
    enough = inliers[reached] >= k
    kept = enough[np.arange(len(chosen)), np.minimum(chosen, inliers.shape[1] - 1)]
    as_often = np.flatnonzero(enough.sum(0) >= kept.sum())
    fixed = int(as_often[0]) if len(as_often) else None
    return Coverage(
        asked, float(kept.mean()), float(chosen.mean()), fixed, len(chosen), int(np.count_nonzero(~reached))
    )

"""Inliers at every budget of points, and the fewest points that give k of them (paper, succinctness)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sips_lit.match.mutual_nearest import MutualLifetimes


def inliers_by_budget(lifetimes: MutualLifetimes, inlier: NDArray[np.bool_], n_max: int) -> NDArray[np.int64]:
    """inliers(n) for n = 0 … n_max, (n_max + 1,), from one verification of all matches that ever exist.

    ``inlier`` (M,) answers for each pair of ``lifetimes``. Right only where the answer for a match does not depend on
    the other matches (ground truth, KLT).
    """
    begin, end = lifetimes.first[inlier], lifetimes.last[inlier] + 1
    born = np.bincount(np.minimum(begin, n_max + 1), minlength=n_max + 2)
    died = np.bincount(np.minimum(end, n_max + 1), minlength=n_max + 2)
    return np.cumsum(born - died, dtype=np.int64)[: n_max + 1]


def points_needed(inliers: NDArray[np.int64], k: int) -> int | None:
    """n_k: the smallest n with ``inliers[n] >= k``, None if there is none."""
    enough = np.flatnonzero(inliers >= k)
    return int(enough[0]) if len(enough) else None


def binary_search(count: Callable[[int], int], k: int, n_max: int) -> int | None:
    """n_k by the paper's binary search: ``count(n)`` inliers for about log2(n_max) budgets n in [k, n_max].

    It takes inliers to grow with n, which is false in general: a new point can break a match. So it finds *an* n with k
    inliers whose predecessor n - 1 lacked them, not always the smallest, and gives None whenever ``n_max`` itself lacks
    them. It halves [0, n_max] whatever k is, so that searches for different k ask for the same budgets. For verification
    that must be run for each set of matches (RANSAC).
    """
    if k > n_max or count(n_max) < k:
        return None
    low, high = 0, n_max  # high always has k inliers
    while low < high:
        middle = (low + high) // 2
        if middle >= k and count(middle) >= k:
            high = middle
        else:
            low = middle + 1
    return high

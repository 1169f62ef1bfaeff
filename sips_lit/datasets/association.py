"""Joining what different sensors recorded: by the nearest time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def nearest_in_time(times: NDArray[Any], others: NDArray[Any], tolerance: float) -> NDArray[np.int64]:
    """For each time (N,) the index of the nearest of the others (M,), in any order; -1 beyond the tolerance.

    All three are in one unit, such as int64 nanoseconds or seconds.
    """
    order = np.argsort(others, kind="stable")
    ordered = others[order]
    after = np.searchsorted(ordered, times).clip(0, len(others) - 1)
    before = (after - 1).clip(0)
    nearest = np.where(np.abs(ordered[before] - times) <= np.abs(ordered[after] - times), before, after)
    within = np.abs(ordered[nearest] - times) <= tolerance
    return np.where(within, order[nearest], -1)

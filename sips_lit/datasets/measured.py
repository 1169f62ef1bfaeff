"""Sequences of which more is known than images, and the joining of what different sensors recorded."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import Camera, FloatArray, ImageSequence


class MeasuredSequence(ImageSequence):
    """N image ``files``, with what was known of their frames before any was read.

    A subclass sets what its data set has: ``_camera``, one for all frames; ``_poses``, N of ``T_world_camera`` (4, 4), None
    where none was measured; ``_times`` (N,) in seconds; ``_baseline`` in metres, where there are right images.
    """

    files: list[Path]
    _camera: Camera | None = None
    _poses: Sequence[FloatArray | None] | FloatArray | None = None
    _times: Sequence[float] | FloatArray | None = None
    _baseline: float | None = None

    def __len__(self) -> int:
        return len(self.files)

    def frame_name(self, index: int) -> str:
        """The sequence's name and that of the image file."""
        return f"{self.name}_{self.files[index].stem}"

    def camera(self, index: int) -> Camera | None:
        """The same for every frame."""
        return self._camera

    def pose(self, index: int) -> FloatArray | None:
        """``T_world_camera``, or None where it was not measured."""
        return None if self._poses is None else self._poses[index]

    def time(self, index: int) -> float | None:
        """When the image was taken, in seconds on the clock of the data set."""
        return None if self._times is None else float(self._times[index])

    def baseline(self) -> float | None:
        """Metres from the camera to that of the right images; None if there are none."""
        return self._baseline


def joined_in_time(
    times: NDArray[Any], others: NDArray[Any], things: Sequence[Any] | NDArray[Any], tolerance: float
) -> list[Any | None]:
    """For each time (N,) what belongs to the nearest of the others: of M things one; None beyond the tolerance."""
    return [None if at < 0 else things[at] for at in nearest_in_time(times, others, tolerance)]


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

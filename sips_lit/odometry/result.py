"""What was measured of a method with n points a frame on a sequence, and what a frame weighs on the air."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.metrics.trajectory import TrajectoryErrors, trajectory_errors
from sips_lit.odometry.odometer import Located, State
from sips_lit.types import Features

PLACE_BYTES: Final = 4
"""Of a point: x and y in 16 bits each."""
ERRORS: Final = ("drift", "ate", "rpe_translation", "rpe_rotation", "drift_rotation")
"""Fields of `TrajectoryErrors` that a table may have."""


def message_bytes(features: Features) -> int:
    """What a robot sends to have a frame matched: N places, 16 bits a coordinate, and N descriptors as they are stored."""
    return len(features) * PLACE_BYTES + features.descriptors.nbytes


@dataclass(frozen=True, slots=True)
class Run:
    """One pass over the N frames with one seed: ``poses`` (N, 4, 4) ``T_world_camera``, how each came about (N,), errors.

    ``errors`` is None where no true pose is known.
    """

    poses: NDArray[np.float64]
    state: NDArray[np.uint8]
    inliers: NDArray[np.int64]
    keyframe: NDArray[np.bool_]
    errors: TrajectoryErrors | None

    @property
    def bridged(self) -> int:
        """How many frames had too few inliers."""
        return int((self.state == State.BRIDGED).sum())


@dataclass(frozen=True, slots=True)
class OdometryResult:
    """A method with ``n`` points a frame: a `Run` per seed, and means over the frames.

    ``points`` and ``bytes`` of a frame; ``milliseconds`` of a frame by stage: detect, describe, depth, pose.
    """

    key: str
    name: str
    n: int
    runs: tuple[Run, ...]
    points: float
    bytes: float
    milliseconds: Mapping[str, float]

    def over_runs(self, value: Callable[[Run], float]) -> tuple[float, float]:
        """Mean and standard deviation of a value over the seeds (0 for one seed)."""
        values = np.array([value(run) for run in self.runs], np.float64)
        return float(values.mean()), float(values.std(ddof=1)) if len(values) > 1 else 0.0

    def error(self, name: str) -> tuple[float, float]:
        """Mean and deviation of a field of `TrajectoryErrors`; NaN without true poses."""
        return self.over_runs(lambda run: math.nan if run.errors is None else getattr(run.errors, name))

    @property
    def bridged(self) -> tuple[float, float]:
        """Frames with too few inliers."""
        return self.over_runs(lambda run: run.bridged)

    @property
    def keyframes(self) -> float:
        """Mean number of keyframes."""
        return self.over_runs(lambda run: int(run.keyframe.sum()))[0]

    @property
    def inliers(self) -> float:
        """Median over the frames after the first, mean over the seeds."""
        return self.over_runs(lambda run: float(np.median(run.inliers[1:])))[0]


@dataclass(frozen=True, slots=True)
class SequenceResult:
    """All methods on one sequence of N frames.

    ``truth`` (N, 4, 4) with NaN where it is not known; ``times`` (N,) in seconds, or frame numbers where the data has none.
    """

    name: str
    protocol: Mapping[str, Any]
    times: NDArray[np.float64]
    truth: NDArray[np.float64]
    results: tuple[OdometryResult, ...]
    skipped: Mapping[str, str]

    @property
    def judged(self) -> bool:
        """Whether true poses are known."""
        return bool(np.isfinite(self.truth).any())


def make_run(located: Sequence[Located], truth: NDArray[np.float64], segment: float) -> Run:
    """A pass over N frames, judged by the true poses (N, 4, 4) that are known, not NaN."""
    poses = np.stack([one.pose for one in located])
    known = np.asarray(np.isfinite(truth).all((1, 2)), np.bool_)
    return Run(
        poses,
        np.array([one.state for one in located], np.uint8),
        np.array([one.inliers for one in located], np.int64),
        np.array([one.keyframe for one in located], np.bool_),
        trajectory_errors(poses, truth, known, segment) if known.sum() > 1 else None,
    )

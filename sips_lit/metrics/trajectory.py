"""How far an estimated trajectory is from the true one: absolute, per frame, and per distance travelled.

Absolute and relative errors as Sturm et al. (A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012), segments as
Geiger et al. (KITTI odometry, CVPR 2012). Trajectories are (N, 4, 4) ``T_world_camera`` in metres, each in its own world.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sips_lit.geometry.pose import rotation_error
from sips_lit.types import FloatArray


@dataclass(frozen=True, slots=True)
class TrajectoryErrors:
    """What is wrong with a trajectory; NaN where there is nothing to measure.

    ``ate``: root mean square distance of the places after alignment, metres; ``rpe_translation`` (metres) and
    ``rpe_rotation`` (degrees): root mean square errors of the motion from each frame to the next; ``drift``: error at the
    end of segments, percent of their length, and ``drift_rotation`` in degrees per metre, means over ``segments`` segments
    of at least ``segment`` metres.
    """

    ate: float
    rpe_translation: float
    rpe_rotation: float
    drift: float
    drift_rotation: float
    segment: float
    segments: int


def trajectory_errors(
    estimate: FloatArray, truth: FloatArray, known: NDArray[np.bool_], segment: float = 100.0
) -> TrajectoryErrors:
    """All of them for N poses, of which those that are ``known`` (N,) have a true one.

    A segment is ``segment`` metres long, or half of the path where that is shorter, so that short sequences have a drift,
    too (our choice). Relative errors are of frames that follow each other and are both known.
    """
    estimate, truth = np.asarray(estimate, np.float64), np.asarray(truth, np.float64)
    follow = np.flatnonzero(known[:-1] & known[1:])
    relative = motion_errors(estimate, truth, follow, follow + 1)
    at = np.flatnonzero(known)
    own, true = estimate[at], truth[at]
    steps = np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1)
    path = np.concatenate([[0.0], steps.cumsum()])
    length = min(segment, float(path[-1]) / 2)
    first, last = segments_of(path, length) if length > 0 else (at[:0], at[:0])
    translation, rotation = motion_errors(own, true, first, last)
    travelled = path[last] - path[first]
    return TrajectoryErrors(
        ate=absolute_error(own[:, :3, 3], true[:, :3, 3]),
        rpe_translation=_rms(relative[0]),
        rpe_rotation=_rms(relative[1]),
        drift=_mean(100 * translation / travelled),
        drift_rotation=_mean(rotation / travelled),
        segment=length,
        segments=len(first),
    )


def align(places: FloatArray, truth: FloatArray) -> NDArray[np.float64]:
    """The rigid motion (4, 4) of places (N, 3) with the least squared distance to the true ones (N, 3).

    Umeyama (PAMI 1991) without scale: depth gives metres.
    """
    a, b = np.asarray(places, np.float64), np.asarray(truth, np.float64)
    U, _, Vt = np.linalg.svd((b - b.mean(0)).T @ (a - a.mean(0)))
    proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])  # a rotation, no mirror
    T = np.eye(4)
    T[:3, :3] = U @ proper @ Vt
    T[:3, 3] = b.mean(0) - T[:3, :3] @ a.mean(0)
    return T


def absolute_error(places: FloatArray, truth: FloatArray) -> float:
    """Root mean square distance (metres) of N places (N, 3) to the true ones, after `align`; NaN for fewer than two."""
    if len(places) < 2:
        return float("nan")
    T = align(places, truth)
    return _rms(np.linalg.norm(places @ T[:3, :3].T + T[:3, 3] - truth, axis=1))


def motion_errors(
    estimate: FloatArray, truth: FloatArray, first: NDArray[np.int64], last: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Errors of the M motions from frames ``first`` to frames ``last`` (M,): translation in metres, rotation in degrees."""
    errors = []
    for a, b in zip(first, last, strict=True):
        own = np.linalg.solve(estimate[a], estimate[b])
        true = np.linalg.solve(truth[a], truth[b])
        errors.append((np.linalg.norm(np.linalg.solve(own, true)[:3, 3]), rotation_error(own, true)))
    columns = np.array(errors, np.float64).reshape(-1, 2)
    return columns[:, 0], columns[:, 1]


def segments_of(path: FloatArray, length: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """From every frame to the first one that is ``length`` further on the ``path`` (N,), metres travelled at each frame."""
    last = np.searchsorted(path, np.asarray(path) + length)
    first = np.flatnonzero(last < len(path))
    return first, last[first]


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")


def _mean(values: FloatArray) -> float:
    return float(np.mean(values)) if len(values) else float("nan")

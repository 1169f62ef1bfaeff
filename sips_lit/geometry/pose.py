"""Poses: an estimated one, how far it is from the true one (paper, pose errors), and rotations as quaternions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.types import FloatArray

_FLAT: Final = 1e-6  # points this much nearer to a line than long determine no pose


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """``T_1_0`` (4, 4) float64 or None without a pose, and which of the M correspondences agree with it, (M,) bool."""

    T_1_0: NDArray[np.float64] | None
    inlier: NDArray[np.bool_]

    @property
    def inliers(self) -> int:
        """How many agree."""
        return int(self.inlier.sum())


def on_a_line(points: FloatArray) -> bool:
    """Whether N points (N, D), N >= 2, are on one line, or all in one place."""
    spread = np.linalg.svd(points - points.mean(0), compute_uv=False)
    return bool(spread[1] <= _FLAT * spread[0])


def translation_error(estimate: FloatArray, truth: FloatArray) -> float:
    """Euclidean distance of the translations of two poses (4, 4), in their unit (metres)."""
    return float(np.linalg.norm(np.asarray(estimate, np.float64)[:3, 3] - np.asarray(truth, np.float64)[:3, 3]))


def rotation_error(estimate: FloatArray, truth: FloatArray) -> float:
    """Geodesic distance of the rotations of two poses (4, 4), in degrees."""
    R = np.asarray(estimate, np.float64)[:3, :3].T @ np.asarray(truth, np.float64)[:3, :3]
    # The arc cosine alone would lose half the digits of a small angle; the sine has them.
    sine = np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    return float(np.degrees(np.arctan2(sine, (np.trace(R) - 1) / 2)))


def to_rotation(quaternion: FloatArray) -> NDArray[np.float64]:
    """Rotation matrices (N, 3, 3) of quaternions (N, 4) in the order x, y, z, w; their length does not matter.

    NaN for a quaternion of length 0.
    """
    q = np.asarray(quaternion, np.float64)
    with np.errstate(invalid="ignore"):
        x, y, z, w = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def to_quaternion(rotation: FloatArray) -> NDArray[np.float64]:
    """Unit quaternions (N, 4) in the order x, y, z, w, with w >= 0, of rotation matrices (N, 3, 3).

    The largest eigenvector of a symmetric matrix, which no angle makes singular (Bar-Itzhack, JGCD 2000).
    """
    R = np.asarray(rotation, np.float64).reshape(-1, 3, 3)
    symmetric = np.empty((len(R), 4, 4))
    symmetric[:, :3, :3] = R + R.transpose(0, 2, 1)
    trace = np.trace(R, axis1=1, axis2=2)
    symmetric[:, range(3), range(3)] -= trace[:, None]
    antisymmetric = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], 1)
    symmetric[:, :3, 3] = symmetric[:, 3, :3] = antisymmetric
    symmetric[:, 3, 3] = trace
    quaternion = np.linalg.eigh(symmetric)[1][:, :, -1]
    return np.where(quaternion[:, 3:] < 0, -quaternion, quaternion)

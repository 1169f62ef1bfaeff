"""Trajectories as files that other tools read: of TUM and of KITTI."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from sips_lit.files import make_folder, write_whole
from sips_lit.geometry.pose import to_quaternion
from sips_lit.types import FloatArray


def write_tum(path: Path, times: Sequence[float], poses: FloatArray) -> None:
    """N lines ``timestamp tx ty tz qx qy qz qw`` of ``T_world_camera`` (N, 4, 4); seconds, metres.

    Raises BadInputError when the file cannot be written.
    """
    places, quaternions = poses[:, :3, 3], to_quaternion(poses[:, :3, :3])
    rows = np.column_stack([places, quaternions]).tolist()
    _write(path, ([f"{t:.9f}", *(f"{v:.9f}" for v in row)] for t, row in zip(times, rows, strict=True)))


def write_kitti(path: Path, poses: FloatArray) -> None:
    """N lines of the 12 numbers of the upper 3x4 part of ``T_world_camera`` (N, 4, 4), row by row; metres.

    Raises BadInputError when the file cannot be written.
    """
    _write(path, ([f"{v:.9e}" for v in pose[:3].ravel().tolist()] for pose in poses))


def _write(path: Path, rows: Iterable[list[str]]) -> None:
    make_folder(path.parent)
    write_whole(path, "".join(" ".join(row) + "\n" for row in rows).encode())

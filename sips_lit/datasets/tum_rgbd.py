"""The layout of TUM RGB-D (Sturm et al., IROS 2012): lists of files with times, joined by the nearest time."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sips_lit.datasets.layout import expect, is_pose, listed_file, read_rows, read_table, to_numbers, wrong_layout
from sips_lit.datasets.measured import joined_in_time
from sips_lit.datasets.rgbd_sequence import RgbdFrames
from sips_lit.errors import BadInputError
from sips_lit.frames.image_size import image_size
from sips_lit.frames.listing import list_images
from sips_lit.geometry.pose import to_rotation
from sips_lit.types import Camera, FloatArray

LAYOUT = "TUM RGB-D has rgb.txt, depth.txt, groundtruth.txt, and the images that the first two name"
SIZE = (640, 480)
ROUNDING = 1e-6  # seconds: the times count from 1970, and their last bit is a quarter of a microsecond
METRES_A_STEP = 1 / 5000  # of the depth maps
# published calibrations of the three cameras: fx, fy, cx, cy (pixels of 640x480), and k1, k2, p1, p2, k3
CALIBRATIONS: dict[int, tuple[tuple[float, ...], tuple[float, ...] | None]] = {
    1: ((517.3, 516.5, 318.6, 255.3), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    2: ((520.9, 521.0, 325.1, 249.7), (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    3: ((535.4, 539.2, 320.1, 247.6), None),  # its images are undistorted
}


def read_tum(folder: Path, tolerance: float, intrinsics: Sequence[float] | None = None) -> RgbdFrames:
    """Every image of ``rgb.txt`` with the depth map and the pose nearest in time, None beyond ``tolerance`` seconds.

    Where a list is missing, the images of ``rgb`` and ``depth`` are named by their times. Without ``groundtruth.txt`` no
    pose is known.

    ``intrinsics`` (fx, fy, cx, cy) are of images without distortion; None takes the published calibration of the camera
    that the folder's name tells. Raises BadInputError for a missing file, and where no image has a depth map or none has
    a pose.
    """
    times, images, tables = _read_list(folder / "rgb.txt")
    depth_times, depths, more = _read_list(folder / "depth.txt")
    own_depths = joined_in_time(times, depth_times, depths, tolerance + ROUNDING)
    own_poses: list[FloatArray | None] = [None] * len(images)
    joined: list[tuple[Sequence[object], Path, FloatArray]] = [(own_depths, folder / "depth.txt", depth_times)]
    if (table := folder / "groundtruth.txt").exists():
        truth = read_table(table, 8)
        own_poses = joined_in_time(times, truth[:, 0], _poses(truth, table), tolerance + ROUNDING)
        joined.append((own_poses, table, truth[:, 0]))
        more.append(table)
    for parts, what, other in joined:
        if all(part is None for part in parts):
            raise BadInputError(
                f"{what} does not overlap in time with rgb.txt: it has {other.min():.3f} to {other.max():.3f} s, the images "
                f"{times.min():.3f} to {times.max():.3f} s, and none is within {tolerance:g} s"
            )
    camera, distortion = _calibration(folder, images[0], intrinsics)
    return RgbdFrames(
        images, own_depths, own_poses, times.tolist(), camera, distortion, METRES_A_STEP, [*tables, *more]
    )


def _read_list(table: Path) -> tuple[NDArray[np.float64], list[Path], list[Path]]:
    """Times (N,) and files of a list, and what was read; without one those of the folder of its name, by the files' names.

    Raises BadInputError for a line that is neither, and a file that is missing.
    """
    folder = table.with_suffix("")
    if not table.exists() and folder.is_dir() and (images := list_images(folder)):
        try:
            return np.array([float(image.stem) for image in images]), images, []
        except ValueError as error:
            raise wrong_layout(
                f"{table}, and the images of {folder} are not named by their times", folder, LAYOUT
            ) from error
    times, files = [], []
    for line, fields in read_rows(expect(table, LAYOUT)):
        if len(fields) != 2:
            raise BadInputError(f"line {line} of {table} must be a time and a file, not {len(fields)} words")
        times += to_numbers(table, line, fields[:1])
        files.append(expect(listed_file(table.parent, fields[1], f"line {line} of {table}"), LAYOUT))
    if not files:
        raise BadInputError(f"{table} names no file: it is empty or was not downloaded whole")
    return np.array(times), files, [table]


def _poses(truth: FloatArray, table: Path) -> NDArray[np.float64]:
    """``T_world_camera`` (N, 4, 4) of rows (N, 8): time, place, quaternion x, y, z, w."""
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(truth[:, 4:], axis=1)
    wrong = np.flatnonzero(~(np.abs(lengths - 1) <= 0.05))
    if len(wrong):
        raise BadInputError(
            f"{table} has a quaternion of length {lengths[wrong[0]]:.3g}, which is no rotation: download it again"
        )
    poses = np.tile(np.eye(4), (len(truth), 1, 1))
    poses[:, :3, :3] = to_rotation(truth[:, 4:])
    poses[:, :3, 3] = truth[:, 1:4]
    if not is_pose(poses).all():
        raise BadInputError(f"{table} has a position that is no place on earth, in metres: download it again")
    return poses


def _calibration(
    folder: Path, image: Path, intrinsics: Sequence[float] | None
) -> tuple[Camera, tuple[float, ...] | None]:
    size = image_size(image)
    if intrinsics is not None:
        if len(intrinsics) != 4 or not min(intrinsics[:2]) > 0:
            raise BadInputError(f"data.intrinsics is {list(intrinsics)}: give [fx, fy, cx, cy] in pixels of the images")
        return Camera(_matrix(intrinsics), size), None
    named = re.search(r"(?:freiburg|fr)_?([123])", folder.resolve().name.lower())
    if named is None or size != SIZE:
        raise BadInputError(
            f"the camera of {folder} is not known: its images are {size[0]}x{size[1]} and its name should tell freiburg1, 2 "
            "or 3 with images of 640x480; give data.intrinsics=[fx, fy, cx, cy]"
        )
    published, distortion = CALIBRATIONS[int(named[1])]
    return Camera(_matrix(published), size), distortion


def _matrix(intrinsics: Sequence[float]) -> NDArray[np.float64]:
    fx, fy, cx, cy = intrinsics
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])

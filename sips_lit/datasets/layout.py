"""What the folders of the published data sets must look like, and what to say where they do not.

Shared by the loaders: missing parts, text tables with the file and the line of a bad number, and fingerprints.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.files import can_be_path, read_text
from sips_lit.frames.listing import some_of
from sips_lit.types import Camera

NEAREST, FARTHEST = 0.01, 1000  # focal lengths, in sides of an image: of a fisheye, and of a telescope
FURTHEST = 1e9  # metres from the origin that a camera may be


def expect(path: Path, layout: str) -> Path:
    """The path itself if it exists; else BadInputError: what is missing, what is there instead, how it should be."""
    if not path.exists():
        raise wrong_layout(str(path), path.parent, layout)
    return path


def expect_files(files: Sequence[Path], what: str, hint: str) -> None:
    """Raises BadInputError where files are missing: how many of ``what``, the first of them, and what to do."""
    absent = [file for file in files if not file.is_file()]
    if absent:
        raise BadInputError(f"{len(absent)} of {len(files)} {what} are missing, the first is {absent[0]}: {hint}")


def files_there(files: Iterable[Path]) -> list[Path | None]:
    """The files, None for each that is missing."""
    return [file if file.is_file() else None for file in files]


def listed_file(folder: Path, name: str, where: str) -> Path:
    """The file of ``folder`` that a table names at ``where``, such as "line 3 of data.csv".

    Raises BadInputError when the name leads out of the folder, or can't be that of a file.
    """
    path = PurePath(name.replace("\\", "/"))
    if path.is_absolute() or ".." in path.parts:
        raise BadInputError(f"{where} names {name}, which leaves the folder: do not trust this file")
    if not can_be_path(name):
        raise BadInputError(f"{where} names {name}, which is no name of a file: download it again")
    return folder / path


def wrong_layout(missing: str, place: Path, layout: str) -> BadInputError:
    """The error for a folder ``place`` that lacks what was looked for, ``missing``: one sentence with what is there, and the
    ``layout`` as it should be, such as "a KITTI sequence has image_0/000000.png, ... and calib.txt".
    """
    return BadInputError(f"there is no {missing}: {describe_place(place)}; {layout}")


def describe_place(place: Path) -> str:
    """What is at a path, in words; of a folder its first entries."""
    if place.is_file():
        return f"{place} is a file"
    if not place.is_dir():
        nearest = next((parent for parent in place.parents if parent.is_dir()), None)
        exists = "" if nearest is None else f" (the folder {nearest} exists)"
        return f"the folder {place} does not exist{exists}"
    entries = sorted(p.name + "/" * p.is_dir() for p in place.iterdir() if not p.name.startswith("."))
    return f"{place} has {some_of(entries)}" if entries else f"the folder {place} is empty"


def expect_size(image: NDArray[Any], size: tuple[int, ...], what: str, whose: str, hint: str = "") -> None:
    """Raises BadInputError where an image (H, W) is not of ``size`` (W, H): "``what`` is 4x3, but ``whose`` 5x3``hint``"."""
    height, width = image.shape
    if (width, height) != size:
        raise BadInputError(f"{what} is {width}x{height}, but {whose} {size[0]}x{size[1]}{hint}")


def read_rows(path: Path, delimiter: str | None = None) -> list[tuple[int, list[str]]]:
    """The rows of a text table as (line number from 1, fields); empty lines and those that begin with # are passed over.

    ``delimiter``: None for white space. Raises BadInputError when the file can't be read or is no text.
    """
    try:
        lines = read_text(path).splitlines()
    except OSError as error:
        raise BadInputError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise BadInputError(f"{path} is not a text file: it may be damaged, or packed; download it again") from error
    rows = ((number, line.strip()) for number, line in enumerate(lines, start=1))
    return [
        (number, [field.strip() for field in line.split(delimiter)])
        for number, line in rows
        if line and not line.startswith("#")
    ]


def to_numbers(path: Path, line: int, fields: Sequence[str]) -> list[float]:
    """The fields of a row as numbers. Raises BadInputError with the file and the line where one is not finite."""
    numbers = []
    for field in fields:
        try:
            number = float(field)
        except ValueError as error:
            raise BadInputError(f"line {line} of {path} has {field!r} where a number should be") from error
        if not np.isfinite(number):
            raise BadInputError(f"line {line} of {path} has {field!r}: every number must be finite")
        numbers.append(number)
    return numbers


def to_integer(path: Path, line: int, field: str, what: str) -> int:
    """A field that must be a whole number that 64 bits hold. Raises BadInputError: it is not ``what``."""
    if not re.fullmatch(r"[0-9]{1,19}", field) or int(field) >= 2**63:
        raise BadInputError(f"line {line} of {path} has {field!r}, not {what}")
    return int(field)


def read_table(path: Path, columns: int | Sequence[int], delimiter: str | None = None) -> NDArray[np.float64]:
    """A text table of numbers (rows, columns), at least one row.

    ``columns``: how many each row has, or the counts allowed, one for the whole file; ``delimiter``: None for white space.
    Raises BadInputError with the file and the line for another count, a word, or a number that is not finite.
    """
    allowed = (columns,) if isinstance(columns, int) else tuple(columns)
    rows = read_rows(path, delimiter)
    if not rows:
        raise BadInputError(f"{path} has no numbers: it is empty or was not downloaded whole")
    wanted = len(rows[0][1]) if len(rows[0][1]) in allowed else allowed[0]
    for line, fields in rows:
        if len(fields) != wanted:
            counts = " or ".join(map(str, allowed))
            raise BadInputError(f"line {line} of {path} has {len(fields)} values, not {counts}")
    return np.array([to_numbers(path, line, fields) for line, fields in rows], np.float64)


def read_pose_rows(path: Path) -> NDArray[np.float64]:
    """Poses (N, 4, 4) of a text file whose rows are the first three rows of ``T_world_camera`` (12 numbers, KITTI's form).

    Raises BadInputError with the file and the line where a row is not 12 finite numbers or has no rotation.
    """
    rows = read_table(path, 12)
    lines = [line for line, _ in read_rows(path)]
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    wrong = np.flatnonzero(~is_pose(poses))
    if len(wrong):
        raise BadInputError(
            f"line {lines[wrong[0]]} of {path} is no pose: its 3x3 part is not a rotation, or its place is no place on earth"
        )
    return poses


def read_pose_file(path: Path) -> NDArray[np.float64] | None:
    """The pose (4, 4) of a text file with its four rows of ``T_world_camera``; None where it is said to be unknown.

    Unknown is what has numbers that are not finite, as where tracking was lost. Raises BadInputError for what is no pose.
    """
    rows = [fields for _, fields in read_rows(path)]
    try:
        pose = np.array(rows, np.float64)
    except ValueError:
        pose = np.zeros(0)
    if pose.shape == (4, 4) and not np.isfinite(pose).all():
        return None
    return check_pose(pose, str(path))


def check_pose(pose: NDArray[np.float64], what: str) -> NDArray[np.float64]:
    """The pose (4, 4) itself. Raises BadInputError, which calls it ``what``, where it is no rigid motion."""
    if pose.shape != (4, 4) or not is_pose(pose[None])[0]:
        raise BadInputError(
            f"{what} is no pose: it must be 4 rows of 4 numbers, a rotation, a place, and 0 0 0 1 below"
        )
    return pose


def is_pose(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of N matrices (N, 4, 4) are rigid motions, of a length that is possible; False also for NaN."""
    R = poses[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max((1, 2))
        rigid = (off <= 1e-2) & (np.linalg.det(R) > 0) & (np.abs(poses[:, :3, 3]) <= FURTHEST).all(1)
    return np.asarray(rigid & (poses[:, 3] == (0, 0, 0, 1)).all(1), np.bool_)


def expect_camera(matrix: NDArray[np.float64], size: tuple[int, int], file: Path | str) -> None:
    """Raises BadInputError where a camera matrix (3, 3) in pixels can't be that of images of ``size`` (W, H)."""
    (fx, _, cx), (_, fy, cy), _ = matrix.tolist()
    side = max(size)
    possible = min(size) > 0 and NEAREST * side <= min(fx, fy) and max(fx, fy, abs(cx), abs(cy)) <= FARTHEST * side
    if not (possible and np.isfinite(matrix).all()):
        raise BadInputError(
            f"{file} has focal lengths {fx:g}, {fy:g} and the centre {cx:g}, {cy:g} (pixels), which can't be of images of "
            f"{size[0]}x{size[1]}: correct it, or download it again"
        )


def read_json(path: Path, layout: str) -> dict[str, Any]:
    """The object that a JSON file holds. Raises BadInputError, which says the ``layout``, where it is none."""
    try:
        stored = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise BadInputError(f"{path} is not readable as JSON ({error}): {layout}") from error
    if not isinstance(stored, dict):
        raise BadInputError(f"{path} holds no object of JSON: {layout}")
    return stored


def json_numbers(stored: Mapping[str, Any], keys: Sequence[str], where: str) -> list[float]:
    """What an object of JSON has for those keys. Raises BadInputError where a value is no finite number."""
    numbers = []
    for key in keys:
        try:
            number = float(stored.get(key, math.nan))
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        if not math.isfinite(number):
            raise BadInputError(f"{where} has no finite number {key}: it needs {', '.join(keys)}")
        numbers.append(number)
    return numbers


def json_camera(stored: Mapping[str, Any], keys: Sequence[str], where: str) -> Camera:
    """The camera of six numbers: both focal lengths, the centre (x, y), width and height, in pixels.

    Raises BadInputError where one is missing, or they can't be those of a camera.
    """
    fx, fy, cx, cy, width, height = json_numbers(stored, keys, where)
    matrix, size = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), (int(width), int(height))
    expect_camera(matrix, size, where)
    return Camera(matrix, size)


def files_fingerprint(files: Iterable[Path], *options: object) -> str:
    """A hash of names, sizes and times of files (nothing is read) and of the options that make frames of them.

    The name is the file's with its folder's, so that moving a data set keeps its fingerprint. Raises BadInputError for a
    file that is not there.
    """
    digest = hashlib.sha256(repr(options).encode())
    for file in files:
        try:
            stat = file.stat()
        except OSError as error:
            raise BadInputError(f"cannot read {file}: {error.strerror or error}") from error
        digest.update(f"{file.parent.name}/{file.name}|{stat.st_size}|{stat.st_mtime_ns};".encode())
    return digest.hexdigest()[:16]

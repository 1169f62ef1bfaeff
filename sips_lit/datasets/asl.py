"""Files of the ASL layout (EuRoC MAV, Burri et al., IJRR 2016): cameras, lists of images, true states by time."""

from __future__ import annotations

import contextlib
import reprlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from sips_lit.datasets.layout import (
    expect,
    expect_camera,
    expect_files,
    is_pose,
    listed_file,
    read_rows,
    read_table,
    to_integer,
)
from sips_lit.errors import BadInputError
from sips_lit.files import read_text
from sips_lit.geometry.pose import to_rotation
from sips_lit.geometry.rectify import LensCamera

LAYOUT = (
    "the layout of EuRoC is mav0/ with cam0/ (and cam1/), each with sensor.yaml, data.csv and data/*.png, and, where it is "
    "known, state_groundtruth_estimate0/data.csv (TUM-VI: mocap0/data.csv)"
)
MOST_PIXELS = 2**25  # of an image: the tables of its rectification take 8 bytes for each
MOST_BYTES = 2**16  # of a YAML file, which takes a second to parse then
_SHORT = reprlib.Repr()
_SHORT.maxlevel = 2


@dataclass(frozen=True, slots=True)
class TimedImages:
    """The images of one camera: ``times`` (N,) int64 nanoseconds, ascending, and ``files``."""

    times: NDArray[np.int64]
    files: list[Path]


@dataclass(frozen=True, slots=True)
class States:
    """Where the body was: ``times`` (N,) int64 nanoseconds, ascending, and ``T_world_body`` (N, 4, 4)."""

    times: NDArray[np.int64]
    T_world_body: NDArray[np.float64]


def sensor_file(camera: Path) -> Path:
    """Where the folder of a camera has its calibration: ``sensor.yaml``, or Kalibr's for all cameras, as TUM-VI has it."""
    chain = camera.parent.parent / "dso" / "camchain.yaml"
    own = camera / "sensor.yaml"
    return chain if chain.exists() and not own.exists() else own


def read_sensor(file: Path, camera: str = "cam0") -> tuple[LensCamera, NDArray[np.float64]]:
    """The lens of a sensor.yaml, or of ``camera`` in a camchain.yaml, and ``T_body_camera`` (4, 4).

    Raises BadInputError when a key is missing or not as it should be, or the lens model is another one.
    """
    sensor = _sensor(file, camera)
    model = (sensor.get("camera_model"), sensor.get("distortion_model"))
    if model[0] != "pinhole" or model[1] not in ("radial-tangential", "radtan", "equidistant"):
        raise BadInputError(
            f"{file} has camera_model {model[0]} with distortion_model {model[1]}: only pinhole with radial-tangential or "
            "equidistant can be rectified; data.rectify=false reads the images as they are"
        )
    fx, fy, cx, cy = _numbers(sensor, "intrinsics", (4,), file)
    equidistant = model[1] == "equidistant"
    distortion = _numbers(sensor, "distortion_coefficients", (4,) if equidistant else (4, 5), file)
    size, T = read_mounting(file, camera)
    if min(fx, fy) <= 0:
        raise BadInputError(f"{file} has a focal length that is not positive")
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    expect_camera(matrix, size, file)
    return LensCamera(matrix, distortion, size, equidistant), T


def read_mounting(file: Path, camera: str = "cam0") -> tuple[tuple[int, int], NDArray[np.float64]]:
    """The size (W, H) of the images and ``T_body_camera`` (4, 4) of a file as in `read_sensor`, whatever the lens.

    Raises BadInputError when a key is missing or not as it should be.
    """
    sensor = _sensor(file, camera)
    width, height = _numbers(sensor, "resolution", (2,), file)
    extrinsics = sensor.get("T_BS")
    T = _numbers(extrinsics if isinstance(extrinsics, dict) else {}, "data", (16,), file).reshape(4, 4)
    if min(width, height) <= 0 or not is_pose(T[None])[0]:
        raise BadInputError(f"{file} has a size that is not positive, or a T_BS that is no rigid motion")
    if width % 1 or height % 1 or width > MOST_PIXELS / height:
        raise BadInputError(f"{file} has resolution: [{width:g}, {height:g}], which is no size of an image in pixels")
    return (int(width), int(height)), T


def _sensor(file: Path, camera: str) -> dict[str, Any]:
    """The keys of a sensor.yaml; those of a camchain.yaml (Kalibr) under the same names."""
    content = _read_yaml(expect(file, LAYOUT))
    if file.name != "camchain.yaml":
        return content
    own = content.get(camera)
    if not isinstance(own, dict):
        raise BadInputError(f"{file} has no {camera}: it is of other cameras")
    T_camera_body: NDArray[np.float64] = np.zeros(0)
    with contextlib.suppress(TypeError, ValueError):
        T_camera_body = np.array(own.get("T_cam_imu"), np.float64)
    if T_camera_body.shape != (4, 4) or not is_pose(T_camera_body[None])[0]:
        raise BadInputError(f"{file} has no T_cam_imu for {camera}: it should be 4 rows of 4 numbers, a rigid motion")
    T_body_camera = np.linalg.inv(T_camera_body)
    return {
        **own,
        "distortion_coefficients": own.get("distortion_coeffs"),
        "T_BS": {"data": T_body_camera.ravel().tolist()},
    }


def read_timed_images(camera: Path) -> TimedImages:
    """The images that a camera's data.csv lists. Raises BadInputError when some are not there, or not in order of time."""
    table = expect(camera / "data.csv", LAYOUT)
    times: list[int] = []
    files: list[Path] = []
    for line, fields in read_rows(table, ","):
        if len(fields) != 2:
            raise BadInputError(f"line {line} of {table} is not a time in nanoseconds, a comma and a file name")
        time = to_integer(table, line, fields[0], "a time in nanoseconds, a comma and a file name")
        if times and time <= times[-1]:
            raise BadInputError(f"line {line} of {table} is not later than the line before")
        times.append(time)
        files.append(listed_file(camera / "data", fields[1], f"line {line} of {table}"))
    expect_files(files, f"images that {table} lists", "download the sequence whole, or take their lines out")
    if len(files) < 2:
        raise BadInputError(f"{table} lists {len(files)} images: a sequence needs two or more")
    return TimedImages(np.array(times, np.int64), files)


def read_states(file: Path) -> States:
    """True states: time, position, quaternion (w, x, y, z) of the body; 17 columns as published, or those 8 only.

    Raises BadInputError with the line where a number is bad, a quaternion is not of length one, or time does not go on.
    """
    table = read_table(file, (17, 8), ",")
    lines = [line for line, _ in read_rows(file, ",")]
    off = np.flatnonzero((table[:, 0] < 0) | (table[:, 0] >= 2**63))
    if len(off):
        raise BadInputError(
            f"line {lines[off[0]]} of {file} begins with {table[off[0], 0]:g}, not a time in nanoseconds"
        )
    times = table[:, 0].astype(np.int64)  # through a double: to 0.3 microseconds
    quaternions = table[:, 4:8]
    norms = np.linalg.norm(quaternions, axis=1)
    wrong = np.flatnonzero(np.abs(norms - 1) > 1e-2)
    if len(wrong):
        raise BadInputError(f"line {lines[wrong[0]]} of {file} has a quaternion of length {norms[wrong[0]]:.3g}, not 1")
    back = np.flatnonzero(np.diff(times) <= 0)
    if len(back):
        raise BadInputError(f"line {lines[back[0] + 1]} of {file} is not later than the line before")
    poses = np.tile(np.eye(4), (len(table), 1, 1))
    poses[:, :3, :3] = to_rotation(quaternions[:, [1, 2, 3, 0]])
    poses[:, :3, 3] = table[:, 1:4]
    far = np.flatnonzero(~is_pose(poses))
    if len(far):
        raise BadInputError(f"line {lines[far[0]]} of {file} has a position that is no place on earth, in metres")
    return States(times, poses)


class _PlainLoader(yaml.SafeLoader):
    """No merge keys: merged lists of merged lists grow without an end."""

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Leaves them in, where they have no constructor."""


def _read_yaml(file: Path) -> dict[str, Any]:
    """A YAML file as OpenCV writes it: its header is no YAML directive, and its matrices have a tag of their own."""
    try:
        if file.stat().st_size > MOST_BYTES:
            raise ValueError(f"it is larger than {MOST_BYTES} bytes")
        lines = read_text(file).splitlines()
        text = "\n".join(line for line in lines if not line.startswith("%YAML")).replace("!!opencv-matrix", "")
        content = yaml.load(text, _PlainLoader)
    except Exception as error:  # damaged YAML makes its parser raise almost anything
        raise BadInputError(f"{file} is not readable as YAML: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict):
        raise BadInputError(f"{file} has no keys: {LAYOUT}")
    return content


def _numbers(content: dict[str, Any], key: str, counts: tuple[int, ...], file: Path) -> NDArray[np.float64]:
    value = content.get(key)
    flat = isinstance(value, list) and len(value) in counts and not any(isinstance(v, list | dict) for v in value)
    try:
        numbers = np.asarray(value if flat else np.nan, np.float64)  # names for lists of lists may unfold to terabytes
    except (TypeError, ValueError, OverflowError):
        numbers = np.asarray(np.nan)
    if not np.all(np.isfinite(numbers)):
        wanted = " or ".join(map(str, counts))
        where = "T_BS: data" if key == "data" else key
        raise BadInputError(
            f"{file} has {where}: {_SHORT.repr(value)}, which should be a list of {wanted} finite numbers"
        )
    return numbers

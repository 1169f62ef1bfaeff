"""RGB-D sequences with camera poses: a simple folder layout, and TUM RGB-D as downloaded."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from sips_lit.datasets.layout import expect, json_camera, json_numbers, read_json, read_pose_rows, wrong_layout
from sips_lit.datasets.rgbd_folders import rgbd_sequence, sequence_folders
from sips_lit.datasets.rgbd_sequence import RgbdFrames
from sips_lit.datasets.spec import DatasetSpec, any_of, at_least
from sips_lit.datasets.tum_rgbd import read_tum
from sips_lit.errors import BadInputError
from sips_lit.frames.images import check_max_side
from sips_lit.frames.listing import list_images
from sips_lit.types import Camera, ImageSequence

LAYOUT = (
    "an RGB-D sequence has color/, depth/ (16-bit images), poses.txt (12 numbers a row) and cam.json; or, as TUM RGB-D, "
    "rgb.txt, depth.txt, groundtruth.txt and the files that they name"
)
UNDISTORTED = "perspectiveProjWithoutDistortion"  # ViSP's name of the model


def rgbd(
    path: str | Path,
    tolerance: float = 0.02,
    intrinsics: Sequence[float] | None = None,
    drop_incomplete: bool = False,
    max_side: int | None = None,
) -> list[ImageSequence]:
    """One RGB-D sequence, or those of a folder of such.

    Layouts: ``color/`` and ``depth/`` with ``poses.txt`` (camera to world, KITTI's rows) and ``cam.json``; or TUM RGB-D as
    downloaded (Sturm et al., IROS 2012), where times associate within ``tolerance`` seconds and ``intrinsics`` (fx, fy, cx,
    cy) replace the published ones. ``drop_incomplete`` leaves out frames without depth or pose; ``max_side``: shrink
    images whose longer side exceeds it (pixels), with camera and depth. Raises BadInputError for another layout, and for
    ground truth that does not fit.
    """
    check_max_side(max_side)
    if not tolerance >= 0:
        raise BadInputError(f"data.tolerance is {tolerance}: it must be a time in seconds")

    def read(folder: Path) -> RgbdFrames:
        tum = (folder / "rgb.txt").exists() or not (folder / "color").is_dir()
        return read_tum(folder, tolerance, intrinsics) if tum else read_simple(folder)

    folders = sequence_folders(Path(path), _is_sequence, "RGB-D sequence", LAYOUT)
    return [rgbd_sequence(name, place, read(place), max_side, drop_incomplete) for name, place in folders.items()]


def _is_sequence(folder: Path) -> bool:
    plain = (folder / "rgb").is_dir() and (folder / "groundtruth.txt").is_file()
    return (folder / "rgb.txt").is_file() or (folder / "color").is_dir() or plain


def read_simple(folder: Path) -> RgbdFrames:
    """The frames of a folder with ``color/``, ``depth/``, ``poses.txt`` and ``cam.json``, joined in the order of names.

    Raises BadInputError where something is missing, or the numbers of images, depth maps and poses differ.
    """
    images = list_images(expect(folder / "color", LAYOUT))
    depths = list_images(expect(folder / "depth", LAYOUT))
    table, camera_file = expect(folder / "poses.txt", LAYOUT), expect(folder / "cam.json", LAYOUT)
    if not images:
        raise wrong_layout("image in color/", folder / "color", LAYOUT)
    poses = read_pose_rows(table)
    if not len(images) == len(depths) == len(poses):
        raise BadInputError(
            f"{folder} has {len(images)} images in color/, {len(depths)} depth maps in depth/ and {len(poses)} rows in "
            "poses.txt: there must be as many of each; something was not downloaded whole"
        )
    for image, depth in zip(images, depths, strict=True):
        if _number(image) != _number(depth):
            raise BadInputError(
                f"{image} and {depth} should be of one moment, but have different numbers: a file of {folder} is missing"
            )
    camera, unit = _read_camera(camera_file)
    return RgbdFrames(images, list(depths), list(poses), None, camera, None, unit, [table, camera_file])


def _number(file: Path) -> int | None:
    """The last number in a file's name."""
    numbers = re.findall(r"\d+", file.stem)
    return int(numbers[-1]) if numbers else None


def _read_camera(file: Path) -> tuple[Camera, float]:
    """The camera of ``cam.json`` (ViSP's names: px, py, u0, v0, w, h) and the length of a step of depth in metres."""
    stored = read_json(file, "it has px, py, u0, v0 (pixels), w, h and depthScale (metres)")
    if stored.get("model", UNDISTORTED) != UNDISTORTED:
        raise BadInputError(f"{file} is of the model {stored['model']}: it must be of a camera without distortion")
    (unit,) = json_numbers(stored, ("depthScale",), str(file))
    if not 0 < unit <= 1:
        raise BadInputError(f"{file} has depthScale {unit:g}: a step of the depth maps is positive and 1 metre at most")
    return json_camera(stored, ("px", "py", "u0", "v0", "w", "h"), str(file)), unit


def _simple(path: Path) -> str | None:
    """The sign: two of its parts; colour and depth alone may be anything."""
    return (
        at_least(2, "color", "depth", "poses.txt", "cam.json")(path) if any_of("poses.txt", "cam.json")(path) else None
    )


SPEC = DatasetSpec(
    kind="rgbd",
    title="RGB-D with poses",
    loader=rgbd,
    signs=(
        _simple,
        at_least(2, "rgb.txt", "depth.txt", "groundtruth.txt"),
        at_least(3, "rgb", "depth", "groundtruth.txt"),
    ),
    family=True,
    has=("intrinsics", "poses", "depth"),
    inliers=("klt", "stereo_p3p", "pose_depth"),
)

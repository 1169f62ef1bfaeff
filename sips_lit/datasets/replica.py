"""Replica (Straub et al., 2019) as NICE-SLAM (Zhu et al., CVPR 2022) rendered it: colour and depth in one folder."""

from __future__ import annotations

import re
from pathlib import Path

from sips_lit.datasets.layout import (
    check_pose,
    expect,
    files_there,
    json_camera,
    json_numbers,
    read_json,
    read_rows,
    read_table,
)
from sips_lit.datasets.rgbd_folders import rgbd_sequence, sequence_folders
from sips_lit.datasets.rgbd_sequence import RgbdFrames
from sips_lit.datasets.spec import DatasetSpec, at_least
from sips_lit.errors import BadInputError
from sips_lit.frames.listing import list_images
from sips_lit.types import Camera, ImageSequence

LAYOUT = (
    "Replica has results/frame000000.jpg and results/depth000000.png, ..., traj.txt (16 numbers a row) and, there or one "
    "folder up, cam_params.json"
)
IMAGE = re.compile(r"frame(\d+)\.(jpg|png)")


def replica(path: str | Path, drop_incomplete: bool = False, max_side: int | None = None) -> list[ImageSequence]:
    """A scene, or those of a folder.

    The number in an image's name is its row of ``traj.txt``. ``drop_incomplete`` leaves out frames without depth;
    ``max_side``: shrink images whose longer side exceeds it (pixels), with camera and depth. Raises BadInputError for
    another layout, and files that do not fit.
    """
    folders = sequence_folders(Path(path), _is_scene, "scene of Replica", LAYOUT)
    return [rgbd_sequence(name, place, _read(place), max_side, drop_incomplete) for name, place in folders.items()]


def _is_scene(folder: Path) -> bool:
    return (folder / "results").is_dir() and (folder / "traj.txt").is_file()


def _read(folder: Path) -> RgbdFrames:
    results, table = folder / "results", folder / "traj.txt"
    images = [image for image in list_images(results) if IMAGE.fullmatch(image.name)]
    if not images:
        raise BadInputError(f"{results} has no frame000000.jpg, ...: {LAYOUT}")
    texts = [image.stem.removeprefix("frame") for image in images]
    depths = files_there(results / f"depth{text}.png" for text in texts)
    rows, lines = read_table(table, 16).reshape(-1, 4, 4), [line for line, _ in read_rows(table)]
    if int(texts[-1]) >= len(rows):
        raise BadInputError(f"{table} has {len(rows)} rows, too few for {images[-1]}: they are of different scenes")
    poses = [check_pose(rows[int(text)], f"line {lines[int(text)]} of {table}") for text in texts]
    file = folder / "cam_params.json"
    file = file if file.exists() else expect(folder.resolve().parent / "cam_params.json", LAYOUT)
    camera, unit = _read_camera(file)
    return RgbdFrames(images, depths, list(poses), None, camera, None, unit, [table, file])


def _read_camera(file: Path) -> tuple[Camera, float]:
    """The camera, and the length of a step of depth in metres."""
    stored = read_json(file, "it has w, h, fx, fy, cx, cy (pixels) and scale (steps of depth in a metre)")
    stored = stored["camera"] if isinstance(stored.get("camera"), dict) else stored
    (scale,) = json_numbers(stored, ("scale",), str(file))
    if not scale >= 1:
        raise BadInputError(f"{file} has scale {scale:g}: a metre is 1 step of the depth maps or more")
    return json_camera(stored, ("fx", "fy", "cx", "cy", "w", "h"), str(file)), 1 / scale


SPEC = DatasetSpec(
    kind="replica",
    title="Replica",
    loader=replica,
    signs=(at_least(2, "traj.txt", "results/frame*", "results/depth*.png"),),
    family=True,
    has=("intrinsics", "poses", "depth"),
    inliers=("klt", "stereo_p3p", "pose_depth"),
)

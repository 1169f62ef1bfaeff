"""The format of nerfstudio (Tancik et al., SIGGRAPH 2023): transforms.json with a camera and a pose for each image."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sips_lit.datasets.layout import check_pose, json_camera, json_numbers, listed_file, read_json, wrong_layout
from sips_lit.datasets.rgbd_folders import rgbd_sequence, sequence_folders
from sips_lit.datasets.rgbd_sequence import RgbdFrames, read_array
from sips_lit.datasets.spec import DatasetSpec, any_of
from sips_lit.errors import BadInputError, warn_input
from sips_lit.frames.image_size import first_size, image_size
from sips_lit.frames.listing import in_order
from sips_lit.geometry.image_changes import resize_camera
from sips_lit.types import Camera, FloatArray, ImageSequence

LAYOUT = "nerfstudio's transforms.json has fl_x, fl_y, cx, cy, and frames with file_path and transform_matrix"
RADIAL = ("k1", "k2", "p1", "p2", "k3", "k4")  # in the order of OpenCV, whose k5 and k6 there are not
MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV_FISHEYE")
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # its cameras look along -z, with y up


def nerfstudio(
    path: str | Path, depth_unit: float = 0.001, drop_incomplete: bool = False, max_side: int | None = None
) -> list[ImageSequence]:
    """The images of a ``transforms.json`` in the order of their names, or those of a folder of folders with one.

    A sequence for each camera and folder; lenses are undistorted. Poses, and depth where ``depth_file_path`` names maps,
    are in the unit of the file, which is metres or, from structure from motion, any. ``depth_unit``: what a step of the
    depth maps is in it; ``drop_incomplete`` leaves out frames without depth; ``max_side``: shrink images whose longer side
    exceeds it (pixels). Masks and smaller copies of the images are not read. Raises BadInputError for another layout, and
    for what is not as it should be.
    """
    if not depth_unit > 0:
        raise BadInputError(f"data.depth_unit is {depth_unit}: it must be the length of a step of the depth maps")
    scenes = sequence_folders(Path(path), _is_scene, "transforms.json", LAYOUT)
    sequences: list[ImageSequence] = []
    for name, folder in scenes.items():
        groups = _read(folder, depth_unit)
        names = [name] if len(groups) == 1 else [f"{name}_{number}" for number in range(len(groups))]
        for own, frames in zip(names, groups, strict=True):
            sequences.append(rgbd_sequence(own, folder, frames, max_side, drop_incomplete))
    return sequences


def _is_scene(folder: Path) -> bool:
    return (folder / "transforms.json").is_file()


def _read(folder: Path, unit: float) -> list[RgbdFrames]:
    """The frames of each camera and folder of images."""
    table = folder / "transforms.json"
    stored = read_json(table, LAYOUT)
    if not isinstance(stored.get("frames"), list):
        raise BadInputError(f"{table} has no list of frames: {LAYOUT}")
    entries = {}
    for number, frame in enumerate(stored["frames"]):
        if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
            raise BadInputError(f"frame {number} of {table} has no file_path: {LAYOUT}")
        entries[listed_file(folder, frame["file_path"], f"frame {number} of {table}")] = {**stored, **frame}
    there = [image for image in in_order(entries) if image.is_file()]
    if len(there) < len(entries):
        warn_input(f"{len(entries) - len(there)} of the {len(entries)} images that {table} names are missing")
    groups: dict[tuple[Any, ...], list[tuple[Path, Camera]]] = {}  # by the lens, whether it is equidistant, and others
    for image in there:
        camera, lens, equidistant = _camera(table, image, entries[image])
        key = (lens, equidistant, image.parent, camera.size, lens and tuple(camera.matrix.ravel()))
        groups.setdefault(key, []).append((image, camera))
    pairs = {key: group for key, group in groups.items() if len(group) >= 2}
    if not pairs:
        raise wrong_layout(f"two images of one camera in {table}", folder, LAYOUT)
    if len(pairs) < len(groups):
        warn_input(f"{len(groups) - len(pairs)} images of {table} are the only ones of their camera and are left out")
    return [_frames(table, unit, group, entries, lens, equidistant) for (lens, equidistant, *_), group in pairs.items()]


def _frames(
    table: Path,
    unit: float,
    group: list[tuple[Path, Camera]],
    entries: dict[Path, dict[str, Any]],
    lens: tuple[float, ...] | None,
    equidistant: bool,
) -> RgbdFrames:
    images, cameras = [image for image, _ in group], [camera for _, camera in group]
    named = [entries[image].get("depth_file_path") for image in images]
    where = f"depth_file_path in {table}"
    depths = [listed_file(table.parent, name, where) if isinstance(name, str) else None for name in named]
    depths = [depth if depth and depth.is_file() else None for depth in depths]
    size = first_size(images)
    if size != cameras[0].size:
        raise BadInputError(
            f"{table} has a camera of {cameras[0].size[0]}x{cameras[0].size[1]} for {images[0].name}, which is of size "
            f"{size}: the file must name the images that it is for"
        )
    first = next(filter(None, depths), None)
    own = first and (_array_size(first) if first.suffix == ".npy" else first_size(filter(None, depths)))
    depth_camera = resize_camera(cameras[0], own) if own and min(own) > 0 and own != size else None
    alike = all(np.array_equal(camera.matrix, cameras[0].matrix) for camera in cameras)
    return RgbdFrames(
        images,
        depths,
        [_pose(table, image, entries[image]) for image in images],
        None,
        cameras[0],
        lens,
        unit,
        [table],
        equidistant=equidistant,
        cameras=None if alike else cameras,
        depth_camera=depth_camera,
    )


def _camera(table: Path, image: Path, entry: dict[str, Any]) -> tuple[Camera, tuple[float, ...] | None, bool]:
    """The camera of a frame, its distortion if it has one, and whether it is that of an equidistant lens."""
    model = entry.get("camera_model", "OPENCV")
    if model not in MODELS:
        raise BadInputError(f"{table} has camera_model {model}: only {', '.join(MODELS)} can be read")
    equidistant = model == "OPENCV_FISHEYE"
    keys = ("k1", "k2", "k3", "k4") if equidistant else RADIAL
    where = f"the camera of {image.name} in {table}"
    if "w" not in entry or "h" not in entry:
        entry = entry | dict(zip("wh", image_size(image), strict=True))
    camera = json_camera(entry, ("fl_x", "fl_y", "cx", "cy", "w", "h"), where)
    camera.matrix[:2, 2] -= 0.5  # its pixels have their centres at halves
    lens = tuple(json_numbers(dict.fromkeys(keys, 0) | entry, keys, where))
    if equidistant:
        return camera, lens, True
    full = (*lens, 0.0, 0.0) if lens[5] else lens[:5]
    return camera, full if any(lens) else None, False


def _pose(table: Path, image: Path, entry: dict[str, Any]) -> FloatArray:
    try:
        matrix = np.array(entry.get("transform_matrix"), np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.zeros(0)
    if matrix.shape == (3, 4):
        matrix = np.vstack([matrix, [0, 0, 0, 1]])
    return check_pose(matrix, f"the transform_matrix of {image.name} in {table}") @ OPENGL


def _array_size(file: Path) -> tuple[int, int]:
    height, width = (*read_array(file).shape, 0, 0)[:2]
    return width, height


SPEC = DatasetSpec(
    kind="nerfstudio",
    title="nerfstudio",
    loader=nerfstudio,
    signs=(any_of("transforms.json"),),
    family=True,
    has=("intrinsics", "poses", "depth"),
    inliers=("klt", "pose_depth"),
)

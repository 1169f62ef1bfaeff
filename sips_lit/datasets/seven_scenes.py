"""7-Scenes (Shotton et al., CVPR 2013): colour, depth and pose of each frame as files side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sips_lit.datasets.layout import files_there, read_pose_file
from sips_lit.datasets.rgbd_folders import rgbd_sequence, sequence_folders
from sips_lit.datasets.rgbd_sequence import RgbdFrames
from sips_lit.datasets.spec import DatasetSpec, any_of
from sips_lit.errors import BadInputError
from sips_lit.frames.image_size import first_size
from sips_lit.frames.listing import in_order
from sips_lit.geometry.image_changes import resize_camera
from sips_lit.types import Camera, ImageSequence

LAYOUT = "7-Scenes has seq-01/frame-000000.color.png, frame-000000.depth.png and frame-000000.pose.txt, ..."
SIZE = (640, 480)  # of the images that the intrinsics are for
COLOUR = (525.0, 525.0, 320.0, 240.0)
DEPTH = (585.0, 585.0, 320.0, 240.0)
MILLIMETRE = 0.001
UNKNOWN = 65535  # is stored where the sensor saw nothing


def seven_scenes(
    path: str | Path,
    intrinsics: Sequence[float] = COLOUR,
    depth_intrinsics: Sequence[float] = DEPTH,
    drop_incomplete: bool = False,
    max_side: int | None = None,
) -> list[ImageSequence]:
    """A sequence of 7-Scenes, those of a scene, or those of a folder of scenes.

    Images and depth are as the sensors gave them, not registered, and their cameras were not calibrated: published is what
    the reconstruction took for the depth camera (585, 585, 320, 240). The colour camera sees more; 525 is the nominal focal
    length of its Kinect. A pixel's depth is looked up in its direction as if both cameras were at one place. They are 2.5
    cm apart: poses are of the depth camera, and borders of objects are some pixels off. ``intrinsics`` and
    ``depth_intrinsics`` (fx, fy, cx, cy): in pixels of 640x480, scaled to other images; equal ones for registered depth.
    ``drop_incomplete`` leaves out frames without depth or pose; ``max_side``: shrink images whose longer side exceeds it
    (pixels). Raises BadInputError for another layout, and files that are not what they should be.
    """
    folders = sequence_folders(Path(path), _is_sequence, "sequence of 7-Scenes", LAYOUT, levels=2)
    return [
        rgbd_sequence(name, place, _read(place, intrinsics, depth_intrinsics), max_side, drop_incomplete)
        for name, place in folders.items()
    ]


def _is_sequence(folder: Path) -> bool:
    return _color_and_pose(folder) is not None


def _color_and_pose(folder: Path) -> str | None:
    """The sign: a colour image and a pose, named as here."""
    colour = any_of("frame-*.color.png", "frame-*.color.jpg")(folder)
    return colour if any_of("frame-*.pose.txt")(folder) else None


def _read(folder: Path, intrinsics: Sequence[float], depth_intrinsics: Sequence[float]) -> RgbdFrames:
    images = in_order([*folder.glob("frame-*.color.png"), *folder.glob("frame-*.color.jpg")])
    stems = [image.name.split(".")[0] for image in images]
    depths = files_there(folder / f"{stem}.depth.png" for stem in stems)
    tables = files_there(folder / f"{stem}.pose.txt" for stem in stems)
    camera = _camera("intrinsics", intrinsics, first_size(images) or SIZE)
    depth_camera = _camera("depth_intrinsics", depth_intrinsics, first_size(filter(None, depths)) or SIZE)
    return RgbdFrames(
        images,
        depths,
        [None if table is None else read_pose_file(table) for table in tables],
        None,
        camera,
        None,
        MILLIMETRE,
        [table for table in tables if table],
        depth_camera=depth_camera,
        unknown=UNKNOWN,
    )


def _camera(key: str, intrinsics: Sequence[float], size: tuple[int, int]) -> Camera:
    if len(intrinsics) != 4 or not min(intrinsics[:2]) > 0:
        raise BadInputError(f"data.{key} is {list(intrinsics)}: give [fx, fy, cx, cy] in pixels of 640x480")
    fx, fy, cx, cy = intrinsics
    return resize_camera(Camera(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), SIZE), size)


SPEC = DatasetSpec(
    kind="seven_scenes",
    title="7-Scenes",
    loader=seven_scenes,
    signs=(_color_and_pose,),
    family=True,
    has=("intrinsics", "poses", "depth"),
    inliers=("klt", "stereo_p3p", "pose_depth"),
)

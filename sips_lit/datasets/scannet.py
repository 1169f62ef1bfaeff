"""ScanNet (Dai et al., CVPR 2017) as its tools export it: folders of colour, depth, poses and intrinsics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sips_lit.datasets.layout import expect_camera, files_there, read_pose_file, read_table, wrong_layout
from sips_lit.datasets.rgbd_folders import rgbd_sequence, sequence_folders
from sips_lit.datasets.rgbd_sequence import RgbdFrames
from sips_lit.datasets.spec import DatasetSpec, at_least
from sips_lit.errors import BadInputError
from sips_lit.frames.image_size import first_size
from sips_lit.frames.listing import list_images
from sips_lit.types import Camera, ImageSequence

LAYOUT = (
    "an export of ScanNet has color/0.jpg, depth/0.png and pose/0.txt, ..., intrinsic/intrinsic_color.txt and "
    "intrinsic/intrinsic_depth.txt"
)
MILLIMETRE = 0.001
OFF_CENTRE = 0.15  # of a side: how far the principal point of a whole image may be from its middle


def scannet(path: str | Path, drop_incomplete: bool = False, max_side: int | None = None) -> list[ImageSequence]:
    """A scan, or those of a folder.

    The depth camera's maps are smaller than the images: a pixel's depth is looked up in its direction, both cameras at one
    place as the export gives them. Images that were shrunk to the depth's size have its intrinsics. Frames whose pose
    is not finite (tracking was lost) have none; ``drop_incomplete`` leaves them out, and those without depth; ``max_side``:
    shrink images whose longer side exceeds it (pixels). Raises BadInputError for another layout, and what does not fit.
    """
    folders = sequence_folders(Path(path), _is_scan, "export of ScanNet", LAYOUT)
    return [rgbd_sequence(name, place, _read(place), max_side, drop_incomplete) for name, place in folders.items()]


def _is_scan(folder: Path) -> bool:
    return (folder / "color").is_dir() and (folder / "pose").is_dir()


def _read(folder: Path) -> RgbdFrames:
    images = list_images(folder / "color")
    depths = files_there(folder / "depth" / f"{image.stem}.png" for image in images)
    poses = files_there(folder / "pose" / f"{image.stem}.txt" for image in images)
    size, depth_size = first_size(images), first_size(filter(None, depths))
    if size is None:
        raise wrong_layout(f"image in {folder / 'color'}", folder / "color", LAYOUT)
    files, depth_camera = [], None
    if depth_size is not None:
        files.append(_intrinsics(folder, "depth"))
        depth_camera = _camera(files[0], depth_size)
    if depth_camera is None or size != depth_size:
        files.append(_intrinsics(folder, "color"))
    camera = _camera(files[-1], size)
    return RgbdFrames(
        images,
        depths,
        [None if table is None else read_pose_file(table) for table in poses],
        None,
        camera,
        None,
        MILLIMETRE,
        [*files, *(table for table in poses if table)],
        depth_camera=None if size == depth_size else depth_camera,
    )


def _intrinsics(folder: Path, which: str) -> Path:
    names = (f"intrinsic/intrinsic_{which}.txt", f"intrinsic_{which}.txt", f"intrinsics_{which}.txt")
    for name in names:
        if (folder / name).is_file():
            return folder / name
    raise wrong_layout(str(folder / names[0]), folder, LAYOUT)


def _camera(file: Path, size: tuple[int, int]) -> Camera:
    """The camera of a matrix (3, 3) or (4, 4), for images of ``size`` (W, H), which the file does not tell."""
    matrix: NDArray[np.float64] = read_table(file, (4, 3))[:3, :3]
    if matrix.shape != (3, 3) or np.any(matrix[2] != [0, 0, 1]):
        raise BadInputError(f"{file} has no camera matrix: rows fx 0 cx, 0 fy cy, 0 0 1 in pixels")
    expect_camera(matrix, size, file)
    if np.any(np.abs((matrix[:2, 2] + 0.5) / size - 0.5) > OFF_CENTRE):
        raise BadInputError(
            f"{file} is not of images of {size[0]}x{size[1]}: its principal point is at {matrix[0, 2]:g}, {matrix[1, 2]:g}; "
            "write the matrix of the images as they are"
        )
    return Camera(matrix, size)


SPEC = DatasetSpec(
    kind="scannet",
    title="ScanNet export",
    loader=scannet,
    signs=(at_least(3, "color", "depth", "pose", "intrinsic*"),),
    family=True,
    has=("intrinsics", "poses", "depth"),
    inliers=("klt", "stereo_p3p", "pose_depth"),
)

"""A folder of images with poses and sparse depth: a small form of KITTI raw (Geiger et al., IJRR 2013)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sips_lit.archives.npz import npz_members, read_array
from sips_lit.datasets.layout import expect, expect_camera, files_fingerprint, read_pose_rows, read_table, wrong_layout
from sips_lit.datasets.measured import MeasuredSequence
from sips_lit.datasets.spec import DatasetSpec, at_least
from sips_lit.errors import BadInputError
from sips_lit.frames.folder import FolderSequence
from sips_lit.frames.listing import list_images
from sips_lit.types import Camera, FloatArray, ImageSequence

LAYOUT = (
    "the layout is images (0000000000.jpg, ...), poses.txt (one row of 12 numbers per image), cam.txt (3x3) and one "
    "depth_*.npz (an array in metres an image, named like it, 0 where unknown)"
)


class PosedDepthSequence(FolderSequence, MeasuredSequence):
    """The images of ``folder``, with one camera, the pose of each, and its depth from an archive that is read as needed.

    The world of the poses is the first camera where poses.txt is made so. Raises BadInputError when something is missing or
    does not fit.
    """

    def __init__(self, folder: Path) -> None:
        files = list_images(folder) if folder.is_dir() else []
        if len(files) < 2:
            raise wrong_layout(f"{folder} with two images or more", folder, LAYOUT)
        super().__init__(folder, files)
        poses, camera = expect(folder / "poses.txt", LAYOUT), expect(folder / "cam.txt", LAYOUT)
        self.archive = _archive(folder)
        K = read_camera_matrix(camera)
        expect_camera(K, self.size, camera)
        self._camera = Camera(K, self.size)
        self._poses = read_pose_rows(poses)
        if len(self._poses) != len(files):
            raise BadInputError(
                f"{poses} has {len(self._poses)} poses for {len(files)} images: it needs one row per image"
            )
        self._depths = npz_members(self.archive)
        absent = [file.stem for file in files if file.stem not in self._depths]
        if absent:
            raise BadInputError(
                f"{self.archive} lacks the depth of {len(absent)} images, the first is {absent[0]}; {LAYOUT}"
            )
        self.fingerprint = files_fingerprint([poses, camera, self.archive], "posed depth 1", self.fingerprint)

    def depth(self, index: int) -> FloatArray:
        """Depth (H, W) float32 in metres, NaN where unknown.

        Raises BadInputError when its array is damaged, or not of the image's size.
        """
        key = self.files[index].stem
        stored = read_array(self.archive, self._depths[key])
        width, height = self.size
        if stored.shape != (height, width) or stored.dtype.kind not in "iuf":
            raise BadInputError(
                f"the array {key} of {self.archive} has shape {stored.shape} and type {stored.dtype}, but "
                f"{self.files[index].name} is {height} rows of {width} pixels: depth must be numbers, one a pixel"
            )
        with np.errstate(over="ignore"):  # too far for 32 bits is as good as unknown
            depth: NDArray[np.float32] = stored.astype(np.float32)
        depth[~(depth > 0) | ~np.isfinite(depth)] = np.nan
        return depth


def posed_depth(path: str | Path) -> list[ImageSequence]:
    """The sequence of a folder. Raises BadInputError when it is not laid out so, or not whole."""
    return [PosedDepthSequence(Path(path))]


def read_camera_matrix(file: Path) -> NDArray[np.float64]:
    """A camera matrix (3, 3) in pixels from a text file. Raises BadInputError when it is none."""
    K = read_table(file, 3)
    if K.shape != (3, 3) or not (K[0, 0] > 0 and K[1, 1] > 0) or not np.array_equal(K[2], [0, 0, 1]):
        raise BadInputError(
            f"{file} has no camera matrix: three rows fx 0 cx, 0 fy cy, 0 0 1 in pixels, fx and fy positive"
        )
    return K


def _archive(folder: Path) -> Path:
    archives = sorted(folder.glob("depth_*.npz"))
    if not archives:
        raise wrong_layout(f"depth_*.npz in {folder}", folder, LAYOUT)
    if len(archives) > 1:
        raise BadInputError(f"{folder} has {archives[0].name} and {archives[1].name}: keep one archive of depth there")
    return archives[0]


SPEC = DatasetSpec(
    kind="posed_depth",
    title="KITTI raw with poses and depth",
    loader=posed_depth,
    signs=(at_least(2, "poses.txt", "cam.txt", "depth_*.npz"),),
    has=("intrinsics", "poses", "depth"),
    inliers=("klt", "pose_depth"),
)

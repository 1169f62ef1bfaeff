"""KITTI odometry: rectified stereo from a car (Geiger et al., CVPR 2012)."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sips_lit.datasets.layout import (
    expect,
    expect_camera,
    expect_files,
    files_fingerprint,
    read_pose_rows,
    read_rows,
    read_table,
    to_numbers,
    wrong_layout,
)
from sips_lit.datasets.measured import MeasuredSequence
from sips_lit.datasets.spec import DatasetSpec, any_of, at_least
from sips_lit.datasets.split_lists import split_names
from sips_lit.errors import BadInputError
from sips_lit.frames.folder import FolderSequence
from sips_lit.frames.images import check_max_side, shrunk_size
from sips_lit.frames.listing import list_images
from sips_lit.geometry.image_changes import resize_camera
from sips_lit.types import Camera, FloatArray, GreyImage, ImageSequence

LAYOUT = (
    "the layout of KITTI odometry is sequences/00/ with calib.txt and image_0/000000.png, image_1/000000.png, ... "
    "and, where they are published, times.txt and poses/00.txt beside sequences/"
)
PLACES = ("sequences/[0-9][0-9]/", "dataset/sequences/[0-9][0-9]/", "[0-9][0-9]/")  # of its sequences
LARGEST_CONDITION = 1e9  # of a camera matrix in pixels: about the square of its focal length
LONGEST_BASELINE = 100.0  # metres
log = logging.getLogger(__name__)


class KittiSequence(MeasuredSequence, FolderSequence):
    """The left images of one sequence, with the right ones, poses and times where they are there.

    ``folder`` holds calib.txt and the folders of images; ``poses_file`` is for the left grey camera, whose place at the
    first frame is the world. Times count from the start of the sequence. The number in an image's name is its row of the
    poses and times. Raises BadInputError when something is missing or does not fit.
    """

    def __init__(self, folder: Path, poses_file: Path, colour: bool = False, max_side: int | None = None) -> None:
        number = 2 if colour else 0
        super().__init__(folder / f"image_{number}", _images(folder, number), max_side, f"kitti_{folder.name}")
        self._numbers = [_number(file) for file in self.files]
        projections = read_projections(expect(folder / "calib.txt", LAYOUT))
        if number not in projections:
            raise BadInputError(f"{folder / 'calib.txt'} has no line P{number}:, the camera of image_{number}")
        P = projections[number]
        expect_camera(P[:, :3], self.size, folder / "calib.txt")
        self._camera = resize_camera(Camera(P[:, :3], self.size), shrunk_size(self.size, max_side))
        self._right: FolderSequence | None = None
        right_folder = folder / f"image_{number + 1}"
        if right_folder.is_dir() and number + 1 in projections:
            there = {file.stem: file for file in list_images(right_folder)}
            partners = [there.get(file.stem, right_folder / file.name) for file in self.files]
            hint = f"download {right_folder.name} whole, or remove it to do without stereo"
            expect_files(partners, "right images", hint)
            self._right = FolderSequence(right_folder, partners, max_side)
            self._baseline = float((offset(P) - offset(projections[number + 1]))[0])
            if not 0 < self._baseline < LONGEST_BASELINE:
                raise BadInputError(
                    f"{folder / 'calib.txt'} says that the right camera is {self._baseline:g} m to the right of the left "
                    "one: download it again"
                )
        read, listed = [folder / "calib.txt"], 0
        if poses_file.exists():
            read.append(poses_file)
            poses = read_pose_rows(poses_file)
            listed = len(poses)
            self._poses = own = self._rows(poses, poses_file)
            own[:, :3, 3] -= own[:, :3, :3] @ offset(P)  # from the left grey camera to this one
        if (folder / "times.txt").exists():
            read.append(folder / "times.txt")
            times = read_table(folder / "times.txt", 1)[:, 0]
            listed = max(listed, len(times))
            self._times = self._rows(times, folder / "times.txt")
        if listed > len(self._numbers):
            log.warning("%s: %d of %d images of %s are there", self.name, len(self), listed, self.folder)
        right = self._right.fingerprint if self._right else None
        self.fingerprint = files_fingerprint(read, "kitti 1", self.fingerprint, right, colour, max_side)

    def right(self, index: int) -> GreyImage | None:
        """Right image ``index``. Raises BadInputError when it can't be read or is not of the size of the left ones."""
        if self._right is None:
            return None
        if self._right.size != self.size:
            raise BadInputError(f"the images of {self._right.folder} are not of the size of those of {self.folder}")
        return self._right.frame(index)

    def _rows(self, table: NDArray[np.float64], file: Path) -> NDArray[np.float64]:
        """The rows of the table that belong to the images."""
        if max(self._numbers) >= len(table):
            last = self.files[int(np.argmax(self._numbers))]
            raise BadInputError(
                f"{file} has {len(table)} rows, too few for {last}: the images and the file are of different sequences, or "
                "one of them was not downloaded whole"
            )
        return table[self._numbers]


def kitti(
    path: str | Path,
    split: str | None = None,
    sequences: str | int | Sequence[str | int] | None = None,
    colour: bool = False,
    max_side: int | None = None,
) -> list[ImageSequence]:
    """Sequences of the data set: its folder (the one with ``sequences/``, that itself, the parent), or one sequence's.

    ``split``: train, validation or test, None or all for every sequence that is there; or ``sequences`` by name;
    ``colour``: read the colour cameras (as grey); ``max_side``: shrink images whose longer side exceeds it (pixels), with
    their camera. Raises BadInputError when what is asked for is not there, or not whole.
    """
    check_max_side(max_side)
    if sequences is not None and split not in (None, "all"):
        raise BadInputError(
            "data.split and data.sequences both choose sequences: set one of them, leave the other null"
        )
    there = _sequence_folders(Path(path))
    if sequences is not None:
        names = [sequences] if isinstance(sequences, str | int) else sequences
        wanted = [f"{name:02d}" if isinstance(name, int) else name for name in names]
    else:
        wanted = list(there) if split in (None, "all") else split_names("kitti", str(split))
    missing = [name for name in wanted if name not in there]
    if missing or not wanted:
        raise BadInputError(
            f"{path} has no sequence {', '.join(missing) or 'that is asked for'}, only {', '.join(there)}: download it, or "
            "choose by data.sequences, such as [00,05]"
        )
    return [
        KittiSequence(there[name], there[name].parent.parent / "poses" / f"{there[name].name}.txt", colour, max_side)
        for name in wanted
    ]


def offset(P: FloatArray) -> NDArray[np.float64]:
    """Where camera 0's centre is in the frame of the camera with projection (3, 4) from camera 0's frame; metres (3,)."""
    return np.asarray(np.linalg.solve(P[:, :3], P[:, 3]), np.float64)


def read_projections(file: Path) -> dict[int, NDArray[np.float64]]:
    """Projections (3, 4) of the cameras by number from calib.txt; they map points of the left grey camera.

    Raises BadInputError with the line when it isn't 12 finite numbers or the focal length is not positive.
    """
    projections = {}
    for line, fields in read_rows(file):
        if fields[0] not in ("P0:", "P1:", "P2:", "P3:"):  # Tr is the laser scanner's
            continue
        numbers = to_numbers(file, line, fields[1:])
        if len(numbers) != 12 or not (numbers[0] > 0 and numbers[5] > 0 and numbers[10] > 0):
            raise BadInputError(
                f"line {line} of {file} is no 3x4 projection with positive focal lengths: it has {fields[1:]}"
            )
        P = np.array(numbers).reshape(3, 4)
        if not np.linalg.cond(P[:, :3]) < LARGEST_CONDITION:
            raise BadInputError(f"line {line} of {file} is the projection of no camera: its 3x3 part is singular")
        projections[int(fields[0][1])] = P
    return projections


def _sequence_folders(path: Path) -> dict[str, Path]:
    """The sequences by name; ``path`` is any folder from the one above ``dataset`` down to a sequence."""
    if (path / "calib.txt").exists() or any((path / f"image_{camera}").is_dir() for camera in range(4)):
        return {path.resolve().name: path.resolve()}
    found = _sequences_below(path)
    if not found:
        raise wrong_layout(f"sequence in {path}", path, LAYOUT)
    return {folder.name: folder for folder in found}


def _sequences_below(path: Path) -> tuple[Path, ...]:
    found = (tuple(sorted(sub for sub in path.glob(place) if sub.is_dir())) for place in PLACES)
    return next(filter(None, found), ())


def _images(folder: Path, number: int) -> list[Path]:
    place = folder / f"image_{number}"
    files = list_images(place) if place.is_dir() else []
    twice = [a.name for a, b in itertools.pairwise(files) if a.stem == b.stem]
    if twice:
        raise BadInputError(f"{place} has {len(twice)} images twice, the first is {twice[0]}: keep one format of each")
    if len(files) >= 2:
        return files
    if not files and (folder / f"image_{2 - number}").is_dir():
        kind = "colour" if number == 2 else "grey"
        raise BadInputError(
            f"there is no {place} with {kind} images, but image_{2 - number}: set data.colour={str(number == 0).lower()}, "
            f"or download the {kind} images"
        )
    raise wrong_layout(f"{place} with two images or more", place if files else folder, LAYOUT)


def _number(file: Path) -> int:
    if not file.stem.isdecimal():
        raise BadInputError(f"{file} is not named by its number, as 000000.png is: {LAYOUT}")
    return int(file.stem)


def _colour_alone(path: Path) -> dict[str, bool]:
    grey, colour = (
        any_of(*(f"{place}image_{n}/*.{s}" for place in ("", *PLACES) for s in ("png", "jpg")))(path) for n in (0, 2)
    )
    return {"colour": True} if colour and not grey else {}


SPEC = DatasetSpec(
    kind="kitti",
    title="KITTI odometry",
    loader=kitti,
    signs=(
        at_least(2, "image_0", "image_1", "image_2", "image_3", "calib.txt"),
        any_of(
            *(f"{place}{part}" for place in PLACES for part in ("image_[0-3]", "calib.txt")),
            *PLACES[:2],
            "poses/[0-9][0-9].txt",
        ),
    ),
    options=_colour_alone,
    parts=_sequences_below,
    has=("right images", "intrinsics", "poses", "times"),
    inliers=("klt", "stereo_p3p", "pose_depth"),
)

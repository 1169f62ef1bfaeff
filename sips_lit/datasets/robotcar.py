"""Oxford RobotCar: a year of drives through Oxford (Maddern et al., IJRR 2016).

The published images are raw: Bayer mosaics, not undistorted. Their lens models are look-up tables in the data set's own
development kit, so there is no camera here, and no right image of a rectified pair.
"""

from __future__ import annotations

import itertools
import logging
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from sips_lit.datasets.layout import expect_size, files_fingerprint, read_rows, to_integer, wrong_layout
from sips_lit.datasets.measured import MeasuredSequence
from sips_lit.datasets.spec import DatasetSpec, any_of
from sips_lit.datasets.split_lists import only_split
from sips_lit.errors import BadInputError
from sips_lit.files import safe_name
from sips_lit.frames.images import check_max_side, read_stored, resize_max_side
from sips_lit.frames.listing import list_folders
from sips_lit.types import GreyImage, ImageSequence

# the pattern begins with the pixels of the first row; OpenCV's older names begin elsewhere
BAYER = {
    "stereo/left": cv2.COLOR_BayerGBRG2GRAY,
    "stereo/centre": cv2.COLOR_BayerGBRG2GRAY,
    "stereo/right": cv2.COLOR_BayerGBRG2GRAY,
    "mono_left": cv2.COLOR_BayerRGGB2GRAY,
    "mono_rear": cv2.COLOR_BayerRGGB2GRAY,
    "mono_right": cv2.COLOR_BayerRGGB2GRAY,
}
CAMERAS = sorted(BAYER, key=lambda camera: camera != "stereo/centre")  # the loader's own choice first
LONGEST_GAP = 1_000_000  # microseconds between two frames of one sequence
DATE = re.compile(r"\d{4}(-\d\d){5}")
LAYOUT = (
    "the layout of RobotCar is 2014-07-14-14-49-50/ with stereo/centre/1405345790123456.png, ... (or stereo/left, "
    "stereo/right, mono_left, mono_rear, mono_right) and stereo.timestamps (or mono_left.timestamps, ...)"
)
log = logging.getLogger(__name__)


class RobotCarSequence(MeasuredSequence):
    """Consecutive images of one camera: raw Bayer ``files`` named by their time in microseconds since 1970.

    ``crop_bottom``: rows of pixels that are left out below; ``max_side``: then shrink images whose longer side exceeds it.
    """

    def __init__(
        self, name: str, files: Sequence[Path], camera: str, crop_bottom: int, max_side: int | None = None
    ) -> None:
        self.name, self.files, self.max_side = safe_name(name), list(files), max_side
        self.crop_bottom, self._conversion = crop_bottom, BAYER[camera]
        self._times = [int(file.stem) / 1e6 for file in self.files]
        self.fingerprint = files_fingerprint(self.files, "robotcar 1", camera, crop_bottom, max_side)
        self._size: tuple[int, ...] | None = None

    def frame(self, index: int) -> GreyImage:
        """Frame ``index``. Raises BadInputError when it can't be read, is not raw, or not of the size of the first."""
        raw = read_raw(self.files[index])
        if self._size is None:
            self._size = (raw if index == 0 else read_raw(self.files[0])).shape[::-1]
        hint = ": the images of a camera have one size, download it again"
        expect_size(raw, self._size, str(self.files[index]), f"{self.files[0].name} is", hint)
        if self.crop_bottom > raw.shape[0] - 16:
            raise BadInputError(
                f"data.crop_bottom is {self.crop_bottom}, but the images are {raw.shape[0]} pixels high: lower it"
            )
        grey = np.asarray(cv2.cvtColor(raw, self._conversion), np.uint8)
        return resize_max_side(grey[: raw.shape[0] - self.crop_bottom], self.max_side)


def robotcar(
    path: str | Path,
    camera: str = "stereo/centre",
    crop_bottom: int = 160,
    split: str | None = None,
    stride: int = 1,
    max_side: int | None = None,
) -> list[ImageSequence]:
    """The runs in a folder: of each, one sequence for every stretch of images without a gap.

    ``path``: a run (``2014-07-14-14-49-50``), a folder of runs, or of archives that were unpacked side by side
    (``stereo_centre_01/2014-07-14-14-49-50``, ...), whose images are put together. A sequence ends where images that the
    timestamps list are missing, or more than a second passes; it needs two frames. ``camera``: stereo/left, stereo/centre,
    stereo/right, mono_left, mono_rear or mono_right; ``crop_bottom``: rows left out below, where the car is seen;
    ``split``: train, validation or test, None or all for every run; ``stride``: keep every stride-th image (there are 16 a
    second, 11 of the mono cameras); ``max_side``: shrink images whose longer side exceeds it (pixels). Raises BadInputError
    when what is asked for is not there.
    """
    check_max_side(max_side)
    if camera not in BAYER:
        raise BadInputError(f"data.camera is {camera}: choose one of {', '.join(BAYER)}")
    if crop_bottom < 0 or stride < 1:
        raise BadInputError(f"data.crop_bottom is {crop_bottom} and data.stride {stride}: they must be >= 0 and >= 1")
    runs = only_split("robotcar", _find_runs(Path(path), camera), split, path)
    sequences: list[ImageSequence] = []
    for date, folders in runs.items():
        stretches = [part[::stride] for part in _stretches(date, folders, camera)]
        stretches = [part for part in stretches if len(part) >= 2]
        name = f"robotcar_{date}_{camera}"
        for number, files in enumerate(stretches):
            own = name if len(stretches) == 1 else f"{name}_{number}"
            sequences.append(RobotCarSequence(own, files, camera, crop_bottom, max_side))
    if not sequences:
        raise BadInputError(
            f"{path} has no two images in a row of those that the timestamps of {camera} list (at data.stride={stride}): "
            "unpack the archives of this camera whole"
        )
    return sequences


def read_raw(path: Path) -> GreyImage:
    """A Bayer mosaic (H, W) as it is in its file. Raises BadInputError when it can't be read, or is not one of 8 bits."""
    image = read_stored(path)
    if image.ndim != 2 or image.dtype != np.uint8:
        raise BadInputError(
            f"{path} is not a raw image of one channel and 8 bits as published: read converted images by data=folder"
        )
    return np.asarray(image, np.uint8)


def _find_runs(path: Path, camera: str) -> dict[str, list[Path]]:
    """By date the folders of runs that have images of the camera: several where archives were unpacked side by side."""
    # a link may bear the date, or what it leads to
    below = list_folders(path.absolute()) if path.is_dir() else []
    places = {path.absolute(), path.resolve(), *below, *(folder for sub in below for folder in list_folders(sub))}
    runs: dict[str, list[Path]] = {}
    for place in sorted(places):
        if DATE.fullmatch(place.name) and (place / camera).is_dir():
            runs.setdefault(place.name, []).append(place)
    if runs:
        return dict(sorted(runs.items()))
    raise wrong_layout(f"run with {camera}/ in {path}", path, LAYOUT)


def _stretches(date: str, folders: list[Path], camera: str) -> list[list[Path]]:
    """The images of a run in order, cut where images are missing or too much time passes; warns of missing ones."""
    # two archives may both hold an image: any one will do
    there = {image.name: image for folder in folders for image in (folder / camera).glob("*.png")}
    listed = sorted({time for folder in folders for time in _timestamps(folder, camera)})
    stretches: list[list[Path]] = []
    for before, time in itertools.pairwise([-LONGEST_GAP, *listed]):
        if f"{time}.png" not in there:
            continue
        if time - before > LONGEST_GAP or f"{before}.png" not in there:
            stretches.append([])
        stretches[-1].append(there[f"{time}.png"])
    counts = (sum(map(len, stretches)), len(listed), camera, len(stretches))
    if counts[0] < len(listed):
        log.warning("robotcar %s: %d of %d images of %s are there, in %d stretches", date, *counts)
    return stretches


def _timestamps(folder: Path, camera: str) -> Iterator[int]:
    """The times in microseconds of ``<camera>.timestamps``, whose rows are time and number of the archive."""
    file = folder / f"{camera.split('/')[0]}.timestamps"
    if not file.is_file():
        raise wrong_layout(f"{file}, which every archive of the camera has", folder, LAYOUT)
    for line, fields in read_rows(file):
        yield to_integer(file, line, fields[0], "a time in microseconds")


def _camera_there(path: Path) -> dict[str, str]:
    camera = any_of(*CAMERAS)(path)
    return {} if camera in (None, CAMERAS[0]) else {"camera": str(camera)}


SPEC = DatasetSpec(
    kind="robotcar",
    title="Oxford RobotCar",
    loader=robotcar,
    signs=(any_of(*CAMERAS, "stereo.timestamps", "mono_*.timestamps"),),
    options=_camera_there,
    family=True,
    has=("times",),
)

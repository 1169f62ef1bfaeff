"""TUM mono visual odometry: 50 sequences of a hand-held camera (Engel, Usenko and Cremers, 2016).

There is no ground truth within the sequences but a calibration: of the lens (FOV model) and of the light.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.datasets.calibration import (
    PhotometricCorrection,
    read_fov_camera,
    read_inverse_response,
    read_rectified_camera,
    read_vignette,
)
from sips_lit.datasets.layout import expect, expect_size, files_fingerprint, read_rows, to_numbers, wrong_layout
from sips_lit.datasets.measured import MeasuredSequence
from sips_lit.datasets.spec import DatasetSpec, any_of, at_least
from sips_lit.datasets.split_lists import only_split
from sips_lit.errors import BadInputError
from sips_lit.files import safe_name
from sips_lit.frames.folder import FolderSequence
from sips_lit.frames.image_cache import image_cache
from sips_lit.frames.images import check_max_side, resize_max_side, shrunk_size
from sips_lit.frames.listing import list_folders, list_images
from sips_lit.frames.zip_images import ZipSequence
from sips_lit.geometry.fov_camera import FovCamera, Rectification
from sips_lit.geometry.image_changes import resize_camera
from sips_lit.types import Camera, GreyImage, ImageSequence

LAYOUT = (
    "the layout of TUM mono is sequence_01/ with images.zip (or a folder images/), times.txt, camera.txt, pcalib.txt and "
    "vignette.png"
)


class MonoSequence(MeasuredSequence):
    """One sequence: ``folder`` with ``images.zip`` or ``images/``, and the text files.

    ``photometric``: undo the camera's response and vignette (``pcalib.txt``, ``vignette.png``); exposure times stay.
    ``geometric``: rectify to the pinhole camera of ``camera.txt``; without it there is no camera, since that of the images
    is not a pinhole. ``max_side``: shrink images whose longer side exceeds it (pixels), with their camera. What was
    corrected is kept in ``cache_dir``, if given. Raises BadInputError when something that is needed is missing or does
    not fit.
    """

    def __init__(
        self, folder: Path, photometric: bool, geometric: bool, max_side: int | None, cache_dir: str | Path | None
    ) -> None:
        self.folder, self.max_side = folder, max_side
        self.name = safe_name(f"tum_mono_{folder.name}")
        self._images = _images(folder)
        files = [folder / "times.txt"]
        self._times = read_times(expect(files[0], LAYOUT), len(self._images))
        self._lens: FovCamera | None = None
        self._pinhole: Camera | None = None
        self._vignette: Path | None = None
        if photometric or geometric:
            files.append(expect(folder / "camera.txt", LAYOUT))
            self._lens = read_fov_camera(files[-1])
        if self._lens is not None and geometric:
            self._pinhole = pinhole = read_rectified_camera(files[-1], self._lens)
            self._camera = resize_camera(pinhole, shrunk_size(pinhole.size, max_side))
        if self._lens is not None and photometric:
            files += [expect(folder / name, LAYOUT) for name in ("pcalib.txt", "vignette.png")]
            self._response, self._vignette = read_inverse_response(files[-2]), files[-1]
            read_vignette(self._vignette, self._lens.size)  # a bad one is refused now; its table is made when needed
        options = (photometric, geometric, max_side)
        self.fingerprint = files_fingerprint(files, "tum_mono 1", self._images.fingerprint, *options)
        self._kept = image_cache(cache_dir if photometric or geometric else None, self.name, self.fingerprint)

    def __len__(self) -> int:
        return len(self._images)

    def frame(self, index: int) -> GreyImage:
        """Frame ``index``, corrected as asked. Raises BadInputError when it can't be read or is not of the right size."""
        return self._kept(self._images.frame_name(index), lambda: self._corrected(index))

    def _corrected(self, index: int) -> GreyImage:
        image = self._images.frame(index)
        if self._lens is not None:
            name, hint = f"image {self._images.frame_name(index)} of {self.folder}", ": they are of different cameras"
            expect_size(image, self._lens.size, name, "line 2 of its camera.txt says", hint)
        if self._correction is not None:
            image = self._correction(image)
        if self._rectification is not None:
            image = self._rectification(image)
        return resize_max_side(image, self.max_side)

    def frame_name(self, index: int) -> str:
        """The sequence's name and that of the image file."""
        return f"{self.name}_{self._images.frame_name(index)}"

    @cached_property
    def _correction(self) -> PhotometricCorrection | None:
        if self._vignette is None or self._lens is None:
            return None
        return PhotometricCorrection(self._response, read_vignette(self._vignette, self._lens.size))

    @cached_property
    def _rectification(self) -> Rectification | None:
        return None if self._lens is None or self._pinhole is None else Rectification(self._lens, self._pinhole)

    def __getstate__(self) -> dict[str, Any]:
        """Without the tables that each process makes for itself: several megabytes per sequence."""
        return {key: value for key, value in self.__dict__.items() if key not in ("_correction", "_rectification")}


def tum_mono(
    path: str | Path,
    photometric: bool = False,
    geometric: bool = False,
    split: str | None = None,
    max_side: int | None = None,
    cache_dir: str | Path | None = None,
) -> list[ImageSequence]:
    """The sequences of a folder with ``sequence_01``, ..., or the one sequence that ``path`` is. See `MonoSequence`.

    ``split``: train, validation or test, None or all for every sequence that is there. Raises BadInputError when what is
    asked for is not there, or not whole.
    """
    check_max_side(max_side)
    folders = only_split("tum_mono", _sequence_folders(Path(path)), split, path)
    return [MonoSequence(folder, photometric, geometric, max_side, cache_dir) for folder in folders.values()]


def read_times(file: Path, count: int) -> NDArray[np.float64]:
    """Times (count,) in seconds: the second column of ``times.txt``, after the image's number, before its exposure time.

    Raises BadInputError when it doesn't have ``count`` rows, or one is no row of two or three numbers.
    """
    times = []
    for line, fields in read_rows(file):
        if len(fields) not in (2, 3):
            raise BadInputError(
                f"line {line} of {file} has {len(fields)} values: number, time in seconds, exposure time in milliseconds"
            )
        times.append(to_numbers(file, line, fields[1:])[0])
    if len(times) != count:
        raise BadInputError(
            f"{file} has {len(times)} rows, but there are {count} images: one of them was not downloaded whole"
        )
    return np.array(times, np.float64)


def _images(folder: Path) -> FolderSequence | ZipSequence:
    """The folder ``images/`` if it has any, else the archive."""
    unpacked = folder / "images"
    files = list_images(unpacked) if unpacked.is_dir() else []
    return FolderSequence(unpacked, files) if len(files) >= 2 else ZipSequence(expect(folder / "images.zip", LAYOUT))


def _sequence_folders(path: Path) -> dict[str, Path]:
    """The sequences by the name of their folder; half of one counts as one, so that the error names what is missing."""
    parts = any_of("images.zip", "images", "camera.txt", "times.txt")
    if parts(path):
        return {path.resolve().name: path.resolve()}
    found = {sub.name: sub for sub in list_folders(path) if parts(sub)} if path.is_dir() else {}
    if not found:
        raise wrong_layout(f"sequence in {path}", path, LAYOUT)
    return found


SPEC = DatasetSpec(
    kind="tum_mono",
    title="TUM mono",
    loader=tum_mono,
    signs=(at_least(2, "images.zip", "images", "times.txt", "camera.txt", "pcalib.txt", "vignette.png"),),
    family=True,
    has=("times",),
    switches=("geometric", "photometric"),
)

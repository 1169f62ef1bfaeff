"""Where detected points go: npz, one table, pictures, files of hloc and COLMAP. A file has its name when it is whole."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Literal, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.files import disk_of, make_folder, write_whole
from sips_lit.formats.colmap import ColmapDatabase, ColmapText
from sips_lit.formats.hloc import HlocFeatures
from sips_lit.inference.csv_table import CsvTable
from sips_lit.inference.streams import Frame
from sips_lit.render.points import draw_points
from sips_lit.types import Descriptor, Keypoints

Format = Literal["npz", "hloc", "colmap", "colmap_text", "csv", "overlay"]


class PointWriter(Protocol):
    """Takes the points of one frame after the other."""

    @property
    def written(self) -> str:
        """What was written so far, in words."""

    def write(self, frame: Frame, keypoints: Keypoints) -> None:
        """Writes the points of a frame. Raises BadInputError when that is not possible."""

    def close(self) -> None:
        """Ends the output, where something is open; also called after an error."""
        return


def open_writer(kind: Format, folder: Path, fps: float | None, descriptor: Descriptor | None = None) -> PointWriter:
    """The writer of one output format; overlays are a video if the frames have a rate, else pictures.

    ``descriptor`` describes the points in hloc's and COLMAP's files; None leaves descriptors out.
    """
    match kind:
        case "npz":
            return NpzWriter(folder)
        case "csv":
            return CsvWriter(folder / "points.csv")
        case "hloc":
            return FeatureWriter(HlocFeatures(folder / "features.h5"), descriptor)
        case "colmap":
            return FeatureWriter(ColmapDatabase(folder / "database.db"), descriptor)
        case "colmap_text":
            return FeatureWriter(ColmapText(folder / "colmap_text"), descriptor)
        case "overlay":
            return PictureWriter(folder / "overlay") if fps is None else VideoWriter(folder / "overlay.mp4", fps)


class FeatureFile(Protocol):
    """A file of another program, or a folder of them, that takes the features of one image after the other."""

    @property
    def path(self) -> Path:
        """Where it is."""

    @property
    def images(self) -> int:
        """How many were added."""

    def add(
        self, name: str, size: tuple[int, int], keypoints: Keypoints, descriptors: NDArray[Any] | None = None
    ) -> None:
        """Adds an image: its name, size (W, H), N points and their descriptors (N, D)."""

    def close(self) -> None:
        """Finishes it."""


class FeatureWriter:
    """Points with descriptors into a `FeatureFile`; images are called as their files, frames of a video ``<name>.png``."""

    def __init__(self, file: FeatureFile, descriptor: Descriptor | None) -> None:
        self.file, self.descriptor = file, descriptor

    @property
    def written(self) -> str:
        """What was written so far."""
        return f"{self.file.path.name} ({self.file.images} {'image' if self.file.images == 1 else 'images'})"

    def write(self, frame: Frame, keypoints: Keypoints) -> None:
        """Describes and adds the points of a frame."""
        name, (height, width) = frame.file or f"{frame.name}.png", frame.grey.shape
        try:
            name.encode()
        except UnicodeEncodeError as error:
            raise BadInputError(f"the name of {name!r} is no UTF-8, which {self.file.path} needs: rename it") from error
        described = None if self.descriptor is None else self.descriptor.describe(frame.grey, keypoints)
        self.file.add(name, (width, height), keypoints, described)

    def close(self) -> None:
        """Finishes the file, of the frames so far."""
        self.file.close()


class NpzWriter(PointWriter):
    """``<frame>.npz`` with ``keypoints`` (N, 2), ``scores`` (N,), ``scales`` (N,), float32, and ``image_size`` (W, H).

    Also ``covariances`` (N, 2, 2) float32 in pixels squared, of points that have them.
    """

    def __init__(self, folder: Path) -> None:
        make_folder(folder)
        self.folder, self.files = folder, 0

    @property
    def written(self) -> str:
        """What was written so far."""
        return f"{self.files} npz files" if self.files != 1 else "1 npz file"

    def write(self, frame: Frame, keypoints: Keypoints) -> None:
        """Writes one file."""
        buffer, size = io.BytesIO(), np.array(frame.grey.shape[::-1], np.int64)
        arrays: dict[str, Any] = {"keypoints": keypoints.xy, "scores": keypoints.score, "scales": keypoints.scale}
        if keypoints.covariance is not None:
            arrays["covariances"] = keypoints.covariance
        np.savez(buffer, image_size=size, **arrays)
        write_whole(self.folder / f"{frame.name}.npz", buffer.getvalue())
        self.files += 1


class CsvWriter:
    """One table of all points: ``frame,x,y,score,scale``. Numbers are written so that they read back exactly.

    Covariances, of points that have them, follow as ``xx,xy,yy`` in pixels squared.
    """

    def __init__(self, path: Path) -> None:
        self.table, self.rows, self.started = CsvTable(path), 0, False

    @property
    def written(self) -> str:
        """What was written so far."""
        return f"{self.table.path.name} ({self.rows} rows)"

    def write(self, frame: Frame, keypoints: Keypoints) -> None:
        """Appends one row per point."""
        columns = [keypoints.xy, keypoints.score, keypoints.scale]
        if keypoints.covariance is not None:
            columns.append(keypoints.covariance.reshape(-1, 4)[:, [0, 1, 3]])
        self._start(keypoints.covariance is not None)
        numbers = np.column_stack(columns)
        self.table.append([[frame.name, *(str(number) for number in row)] for row in numbers])  # shortest exact float32
        self.rows += len(keypoints)

    def close(self) -> None:
        """Finishes the table, of the frames so far; one that no longer fits on the disk is removed."""
        if not self.table.closed:
            self._start(covariances=False)
        self.table.close()

    def _start(self, covariances: bool) -> None:
        """The head of the table, before the first points."""
        if not self.started:
            self.started = True
            self.table.append([["frame", "x", "y", "score", "scale", *(("xx", "xy", "yy") if covariances else ())]])


class PictureWriter(PointWriter):
    """``<folder>/<frame>.png``: the frame with its points."""

    def __init__(self, folder: Path) -> None:
        make_folder(folder)
        self.folder, self.files = folder, 0

    @property
    def written(self) -> str:
        """What was written so far."""
        return f"{self.folder.name}/ ({self.files} {'picture' if self.files == 1 else 'pictures'})"

    def write(self, frame: Frame, keypoints: Keypoints) -> None:
        """Writes one picture."""
        picture = cv2.cvtColor(draw_points(frame.picture, keypoints), cv2.COLOR_RGB2BGR)
        write_whole(self.folder / f"{frame.name}.png", cv2.imencode(".png", picture)[1].tobytes())
        self.files += 1


class VideoWriter:
    """An mp4 of the frames with their points; it gets its name when it is closed, as half an mp4 plays nowhere.

    OpenCV's encoder takes even sizes only: the last row or column of an odd one is not in the video.
    """

    def __init__(self, path: Path, fps: float) -> None:
        make_folder(path.parent)
        self.path, self.fps, self.frames = path, fps, 0
        self.unfinished = path.with_name(f".{path.stem}.unfinished{path.suffix}")
        self.video: cv2.VideoWriter | None = None

    @property
    def written(self) -> str:
        """What was written so far."""
        return f"{self.path.name} ({self.frames} frames)"

    def write(self, frame: Frame, keypoints: Keypoints) -> None:
        """Appends one picture; all must have the size of the first."""
        height, width = frame.grey.shape
        if self.video is None:
            code = cv2.VideoWriter.fourcc(*"mp4v")
            self.video = cv2.VideoWriter(str(self.unfinished), cv2.CAP_FFMPEG, code, self.fps, (width, height))
        if not self.video.isOpened():
            raise BadInputError(
                f"cannot write a video of {width}x{height} pixels to {self.path}: leave it out (format=[npz,csv])"
            )
        self.video.write(cv2.cvtColor(draw_points(frame.picture, keypoints), cv2.COLOR_RGB2BGR))
        self.frames += 1

    def close(self) -> None:
        """Finishes the video, of the frames so far."""
        if self.video is None:
            return
        self.video.release()
        if self.frames:
            name_video(self.unfinished, self.path, self.frames)
        else:
            self.unfinished.unlink(missing_ok=True)


def name_video(unfinished: Path, path: Path, frames: int) -> None:
    """Gives a written video its name. Raises BadInputError when it is not whole: OpenCV says nothing of a full disk."""
    video = cv2.VideoCapture(str(unfinished))
    found = int(video.get(cv2.CAP_PROP_FRAME_COUNT)) if video.isOpened() else 0
    video.release()
    if found != frames:
        unfinished.unlink(missing_ok=True)
        raise BadInputError(
            f"cannot write {path}: {found} of its {frames} frames fit on the disk {disk_of(path)}: free some space, or "
            "write elsewhere"
        )
    unfinished.replace(path)

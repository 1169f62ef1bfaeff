"""Where detected points go: npz files, one table, and pictures. Every file is whole as soon as its frame is done."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Literal, Protocol

import cv2
import numpy as np

from sips_lit.errors import BadInputError
from sips_lit.files import make_folder, write_whole
from sips_lit.inference.streams import Frame
from sips_lit.render.points import draw_points
from sips_lit.types import Keypoints

Format = Literal["npz", "csv", "overlay"]


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


def open_writer(kind: Format, folder: Path, fps: float | None) -> PointWriter:
    """The writer of one output format; overlays are a video if the frames have a rate, else pictures."""
    if kind == "npz":
        return NpzWriter(folder)
    if kind == "csv":
        return CsvWriter(folder / "points.csv")
    return PictureWriter(folder / "overlay") if fps is None else VideoWriter(folder / "overlay.mp4", fps)


class NpzWriter(PointWriter):
    """``<frame>.npz`` with ``keypoints`` (N, 2), ``scores`` (N,), ``scales`` (N,), float32, and ``image_size`` (W, H)."""

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
        np.savez(buffer, keypoints=keypoints.xy, scores=keypoints.score, scales=keypoints.scale, image_size=size)
        write_whole(self.folder / f"{frame.name}.npz", buffer.getvalue())
        self.files += 1


class CsvWriter:
    """One table of all points: ``frame,x,y,score,scale``. Numbers are written so that they read back exactly."""

    def __init__(self, path: Path) -> None:
        make_folder(path.parent)
        self.path, self.rows = path, 0
        try:
            self.file = path.open("w", newline="", encoding="utf-8")
        except OSError as error:
            raise BadInputError(f"cannot write {path} ({error.strerror}): choose another output folder") from error
        self._append([["frame", "x", "y", "score", "scale"]])

    @property
    def written(self) -> str:
        """What was written so far."""
        return f"{self.path.name} ({self.rows} rows)"

    def write(self, frame: Frame, keypoints: Keypoints) -> None:
        """Appends one row per point."""
        numbers = np.column_stack([keypoints.xy, keypoints.score, keypoints.scale])
        self._append([[frame.name, *(str(number) for number in row)] for row in numbers])  # shortest exact float32
        self.rows += len(keypoints)

    def close(self) -> None:
        """Closes the table."""
        self.file.close()

    def _append(self, rows: list[list[str]]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        try:
            self.file.write(text.getvalue())
            self.file.flush()
        except OSError as error:
            raise BadInputError(f"cannot write {self.path} ({error.strerror}): free some space") from error


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
            self.unfinished.replace(self.path)
        else:
            self.unfinished.unlink(missing_ok=True)

"""Videos, decoded once into a frame cache; one sequence a shot."""

from __future__ import annotations

import glob
import hashlib
import itertools
import json
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError, StorageError, warn_input
from sips_lit.files import can_be_path, read_text, safe_name, write_whole
from sips_lit.frames.footage import Footage, footage_of_video
from sips_lit.frames.images import resize_max_side
from sips_lit.frames.listing import VIDEO_SUFFIXES, list_files, warn_of_others
from sips_lit.frames.recording import Recording, RecordingLoader
from sips_lit.frames.shots import find_cuts
from sips_lit.frames.video_file import VideoFile
from sips_lit.frames.video_frame import VideoFrame
from sips_lit.progress import progress
from sips_lit.types import GreyImage, ImageSequence

VERSION = 3
SHAPE_TOLERANCE = 0.02  # sizes whose sides have ratios within this differ in scale only
SPARE_BYTES = 200_000_000  # left free on the disk


class VideoShot(ImageSequence):
    """Frames ``start`` to ``stop`` of a frame cache: raw grey bytes of ``shape`` (N, H, W), read as needed."""

    def __init__(
        self,
        cache: Path,
        shape: tuple[int, int, int],
        start: int,
        stop: int,
        name: str,
        fingerprint: str,
        damage: str | None = None,
    ) -> None:
        self.cache, self.shape, self.start, self.stop = cache, shape, start, stop
        self.name, self.fingerprint = name, f"{fingerprint}[{start}:{stop}]"
        self.damage = damage

    def __len__(self) -> int:
        return self.stop - self.start

    def frame(self, index: int) -> GreyImage:
        """Frame ``index`` of the shot. Raises BadInputError when the cache is gone."""
        if not 0 <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        _, height, width = self.shape
        size = height * width
        try:  # a map of the file would be faster by microseconds, and thousands of videos would run out of open files
            pixels = np.fromfile(self.cache, np.uint8, size, offset=(self.start + index) * size)
            return pixels.reshape(height, width)
        except (OSError, ValueError) as error:
            raise _lost_cache(self.cache) from error


@RecordingLoader
def video(
    path: str | Path | Sequence[str | Path],
    cache_dir: str | Path,
    max_side: int | None = 640,
    max_frames: int = 5000,
    stride: int = 1,
) -> list[Recording]:
    """The videos that `find_videos` finds, a recording each; calling ``video`` gives the shots of all.

    Every ``stride``-th frame is kept, at most ``max_frames`` of each video, shrunk to ``max_side`` pixels. Frames are
    decoded once into ``cache_dir``; an interrupted decoding goes on where it stopped, a changed video or parameter starts
    it anew. A cut, frames that can't be decoded, and a change of size end a shot: no pair reaches across. Shots of fewer
    than two frames are left out. Warns of damage, and where ``max_frames`` cuts. Raises BadInputError for a missing file,
    one without frames or of changing shape (see `RecordingLoader`), and StorageError for a disk that is too full.
    """
    if max_frames < 2 or stride < 1 or (max_side is not None and max_side < 16):
        raise BadInputError(
            f"a video needs max_frames >= 2, stride >= 1 and max_side >= 16, not {max_frames}, {stride} and {max_side}"
        )
    parameters = {"max_side": max_side, "max_frames": max_frames, "stride": stride}
    files: dict[str, Path] = {}
    for file in dict.fromkeys(file.absolute() for file in find_videos(path)):
        name = safe_name(file.stem)
        files[name if name not in files else f"{name}_{hashlib.sha256(str(file).encode()).hexdigest()[:6]}"] = file
    caches = {name: (file, name, Path(cache_dir), parameters) for name, file in files.items()}
    return [Recording(str(given[0]), partial(_shots, *given), partial(_footage, *given)) for given in caches.values()]


def find_videos(path: str | Path | Sequence[str | Path]) -> list[Path]:
    """The files of a video, a folder of videos, a glob, a text file (.txt) with one of these a line, or a list of these.

    Paths in a text file are relative to its folder; empty lines and those that begin with # are passed over. Warns of
    other files in a folder of videos. Raises BadInputError where there is none.
    """
    if not isinstance(path, str | Path):
        return [file for part in path for file in find_videos(part)]
    root = Path(path)
    if root.is_dir():
        found = list_files(root, VIDEO_SUFFIXES)
        if found:
            warn_of_others(root, found, "videos")
    elif root.is_file():
        found = find_videos(_lines(root)) if root.suffix.lower() == ".txt" else [root]
    else:
        found = _matching(str(path))
    if not found:
        raise BadInputError(
            f"there is no video {path}: data.path must be a video file, a folder of videos, a glob, or a .txt file of these"
        )
    return found


def _lines(file: Path) -> list[Path]:
    try:
        lines = [line.strip() for line in read_text(file).splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(f"cannot read {file} as a list of videos ({error}): write one path a line") from error
    entries = [file.parent / line for line in lines if line and not line.startswith("#")]
    strange = [line for line in lines if not can_be_path(line)]
    if strange:
        raise BadInputError(f"{file} names {strange[0]}, which can't be a file: write one path a line")
    if any(entry.suffix.lower() == ".txt" for entry in entries):
        raise BadInputError(f"{file} names another list: write videos, folders or globs into it, one a line")
    return entries


def _matching(pattern: str) -> list[Path]:
    matches = sorted(Path(file) for file in glob.glob(pattern, recursive=True))  # noqa: PTH207 - absolute patterns
    return [file for file in matches if file.is_file()]


def _shots(file: Path, name: str, cache_dir: Path, parameters: dict[str, Any]) -> list[ImageSequence]:
    fingerprint = _fingerprint(file, parameters)
    cache = cache_dir / f"{name}-{fingerprint[:8]}"
    meta = _read_meta(cache) or _decode(file, cache, parameters)
    if meta["damage"]:
        warn_input(f"{meta['damage']}; no pair is made across a gap")
    if meta["more"]:
        warn_input(f"{file} is longer than data.max_frames={parameters['max_frames']}: the rest is not used")
    shape, cuts = tuple(meta["shape"]), [0, *meta["cuts"], meta["shape"][0]]
    spans = [(a, b) for a, b in itertools.pairwise(cuts) if b - a >= 2]
    return [
        VideoShot(
            cache / "frames.u8",
            shape,
            a,
            b,
            name if len(spans) == 1 else f"{name}_shot{i}",
            fingerprint,
            meta["damage"],
        )
        for i, (a, b) in enumerate(spans)
    ]


def _fingerprint(file: Path, parameters: dict[str, Any]) -> str:
    stat = file.stat()
    source = {"version": VERSION, "bytes": stat.st_size, "mtime_ns": stat.st_mtime_ns, **parameters}
    return hashlib.sha256(json.dumps(source, sort_keys=True).encode()).hexdigest()[:16]


def _footage(file: Path, name: str, cache_dir: Path, parameters: dict[str, Any]) -> Footage | None:
    frames = cache_dir / f"{name}-{_fingerprint(file, parameters)[:8]}" / "frames.u8"
    return footage_of_video(file, **parameters, there=frames.stat().st_size if frames.is_file() else 0)


def _read_meta(cache: Path) -> dict[str, Any] | None:
    """What a finished cache says of itself; None if it is not finished or not whole."""
    try:
        meta: dict[str, Any] = json.loads((cache / "meta.json").read_text())
        count, height, width = shape = meta["shape"]
        ends = [0, *meta["cuts"], count]
        plain = all(type(number) is int for number in (*shape, *ends)) and ends == sorted(ends)
        whole = plain and (cache / "frames.u8").stat().st_size == count * height * width
        return meta if whole and {"cuts", "damage", "more"} <= meta.keys() else None
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None


def _decode(file: Path, cache: Path, parameters: dict[str, Any]) -> dict[str, Any]:
    """Fills the cache of a video and writes what it is; goes on after the whole frames that are already there."""
    frames = cache / "frames.u8"
    try:
        cache.mkdir(parents=True, exist_ok=True)
        decoded = _append_frames(file, frames, parameters)
        cuts = {*find_cuts(iter(_open_frames(frames, decoded.shape))), *decoded.breaks}
        state = {"shape": decoded.shape, "cuts": sorted(cuts), "damage": decoded.damage, "more": decoded.more}
        meta = {"video": file.name, **state, **parameters}
        write_whole(cache / "meta.json", (json.dumps(meta, indent=2) + "\n").encode())
    except OSError as error:
        raise StorageError(
            f"cannot write the frames of {file} to {cache}: {error.strerror or error}; what is there is kept, run it again"
        ) from error
    return meta


@dataclass(frozen=True, slots=True)
class _Decoded:
    """What a frame cache was filled with: (N, H, W), the frames that begin anew after a gap or change of size, what is
    missing of the file, and whether it has more frames than were asked for.
    """

    shape: tuple[int, int, int]
    breaks: list[int]
    damage: str | None
    more: bool


def _append_frames(file: Path, frames: Path, parameters: dict[str, Any]) -> _Decoded:
    """Decodes what is missing; each frame has its fixed place, so two processes at once write the same bytes there."""
    source, stride, limit = VideoFile(file), parameters["stride"], parameters["max_frames"]
    kept = _every(source, stride)
    first, _ = next(kept)
    size = first.size
    height, width = resize_max_side(first.grey(source.span), parameters["max_side"]).shape
    done = frames.stat().st_size // (height * width) if frames.is_file() else 0
    total = min(limit, -(-source.total // stride))
    _check_space(file, frames.parent, (total - done) * height * width)
    frames.touch()
    count, breaks, more = 0, list[int](), False
    with (
        frames.open("r+b") as handle,
        progress(desc=f"decoding {file.name}", unit="frame", total=total, initial=done) as bar,
    ):
        handle.seek(done * height * width)  # a kill may have left part of a frame, which is written over
        for count, (frame, after_hole) in enumerate(itertools.chain([(first, False)], kept)):
            if count == limit:
                more = True
                break
            if after_hole or frame.size != size:
                breaks.append(count)
            size = frame.size
            if count >= done:
                handle.write(
                    _fitted(frame.grey(source.span), (width, height), f"{file}, frame {count * stride},").tobytes()
                )
                bar.update()
        else:
            count += 1
        handle.truncate(count * height * width)
    if count < 2:
        raise BadInputError(f"{file} gives one frame only at data.stride={stride}: a sequence needs two or more")
    return _Decoded((count, height, width), breaks, source.damage, more)


def _every(source: VideoFile, stride: int) -> Iterator[tuple[VideoFrame, bool]]:
    """Every stride-th frame, and whether frames are missing between it and the one before."""
    hole = False
    for index, frame in enumerate(source):
        hole |= frame.after_hole
        if index % stride == 0:
            yield frame, hole
            hole = False


def _fitted(image: GreyImage, size: tuple[int, int], name: str) -> GreyImage:
    """The image scaled to ``size`` (W, H). Raises BadInputError where its shape is another one."""
    check_shape(image.shape[::-1], size, name)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def check_shape(size: tuple[int, ...], before: tuple[int, int], name: str) -> None:
    """Raises BadInputError where a ``size`` (W, H) is not that of frames ``before`` or a scale of it."""
    if abs(size[0] * before[1] / (size[1] * before[0]) - 1) > SHAPE_TOLERANCE:
        raise BadInputError(
            f"{name} is {size[0]}x{size[1]}, of another shape than the frames before: split the video there"
        )


def _check_space(file: Path, folder: Path, needed: int) -> None:
    free = shutil.disk_usage(folder).free
    if needed + SPARE_BYTES > free:
        raise StorageError(
            f"the frames of {file} need {needed / 1e9:.1f} GB in {folder}, where {free / 1e9:.1f} GB are free: lower "
            "data.max_frames or data.max_side, raise data.stride, or set paths.frames to another disk"
        )


def _open_frames(path: Path, shape: tuple[int, int, int]) -> NDArray[np.uint8]:
    try:
        return np.memmap(path, np.uint8, "r", shape=shape)
    except (OSError, ValueError) as error:
        raise _lost_cache(path) from error


def _lost_cache(path: Path) -> BadInputError:
    return BadInputError(f"the frame cache {path} is gone or damaged: run again to decode the video once more")

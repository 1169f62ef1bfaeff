"""How long videos are and how many bytes their frames will take, from the heads of the files: nothing is decoded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np

from sips_lit.frames.images import shrunk_size

SAMPLE = 100  # of more videos so many are looked at, evenly spread


@dataclass(frozen=True, slots=True)
class Footage:
    """``hours`` of video, and ``bytes`` that a frame cache holds of it once it is decoded, of which ``there`` are."""

    hours: float
    bytes: float
    there: float

    @property
    def per_hour(self) -> float:
        """Bytes of an hour of video."""
        return self.bytes / self.hours if self.hours else 0.0

    def __str__(self) -> str:
        hours = f"{self.hours:.1f} hours" if self.hours >= 1 else f"{60 * self.hours:.1f} minutes"
        return (
            f"about {hours} of video: {_size(self.bytes)} of frames ({_size(self.per_hour)} an hour of video), of which "
            f"{_size(self.there)} are there"
        )


def footage_of_all(heads: Sequence[Callable[[], Footage | None]]) -> Footage | None:
    """The footage of many videos, of more than `SAMPLE` by a sample; None where no head of it tells a length."""
    at = np.unique(np.linspace(0, len(heads) - 1, min(len(heads), SAMPLE)).round().astype(int))
    known = [footage for index in at if (footage := heads[index]()) is not None]
    if not known:
        return None
    all_of_one = len(heads) / len(at)
    hours, size, there = (all_of_one * sum(getattr(f, name) for f in known) for name in ("hours", "bytes", "there"))
    return Footage(hours, size, there)


def footage_of_video(file: Path, max_side: int | None, max_frames: int, stride: int, there: int = 0) -> Footage | None:
    """What decoding a video takes with these arguments of `video.video`, as far as its head is true.

    None where it tells no length, size or rate, or is no head of a video.
    """
    try:
        with av.open(str(file.absolute()), metadata_errors="replace") as container:
            stream = max(container.streams.video, key=lambda s: s.width * s.height if s.codec_context else 0)
            rate, size = stream.average_rate or stream.guessed_rate, (stream.width, stream.height)
            own = None if stream.duration is None or stream.time_base is None else stream.duration * stream.time_base
            seconds = own if own is not None else container.duration and container.duration / av.time_base
    except (av.FFmpegError, ValueError, AttributeError):  # broken, without a video, of an unknown codec
        return None
    if not seconds or not rate or not all(size):
        return None
    width, height = shrunk_size(size, max_side)
    kept = min(max_frames, -(-round(seconds * rate) // stride))
    return Footage(float(seconds) / 3600, kept * width * height, there)


def _size(count: float) -> str:
    unit, name = next(((unit, name) for unit, name in ((1e12, "TB"), (1e9, "GB")) if count >= unit), (1e6, "MB"))
    return f"{count / unit:.1f} {name}"

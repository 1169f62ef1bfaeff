"""Sources: sequences with a weight and, if they have a truth of their own, the inlier check that labels them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from sips_lit.errors import BadInputError
from sips_lit.types import Camera, FloatArray, GreyImage, ImageSequence, InlierCheck


@dataclass(frozen=True, slots=True)
class Source:
    """Sequences that are drawn with probability proportional to ``weight`` among the sources of a mixture.

    ``inliers`` labels the pairs of this source; None leaves that to the run's own inlier check. Raises BadInputError for
    a weight that is not positive.
    """

    sequences: Sequence[ImageSequence]
    weight: float = 1.0
    inliers: InlierCheck | None = None
    name: str = "data"

    def __post_init__(self) -> None:
        if not self.weight > 0:
            raise BadInputError(f"the weight of a source is {self.weight:g}; make it positive, or leave the source out")


def mixture(sources: Mapping[str, Source | None]) -> list[Source]:
    """The sources of a mapping by name; those set to null are left out."""
    return [replace(source, name=name) for name, source in sources.items() if source is not None]


def as_sources(data: Sequence[ImageSequence] | Sequence[Source]) -> list[Source]:
    """What ``data=`` gives: the sources of a mixture, or the sequences of one data set as a single source.

    Raises BadInputError when there is no sequence at all.
    """
    sources = [item for item in data if isinstance(item, Source) and item.sequences]
    sequences = [item for item in data if isinstance(item, ImageSequence)]
    if sequences:
        sources.append(Source(sequences))
    if not sources:
        raise BadInputError("the data has no sequence of at least two frames: check data.path")
    return sources


class FrameRange(ImageSequence):
    """Frames ``start`` to ``stop`` (exclusive) of another sequence, with all that is known about them."""

    def __init__(self, whole: ImageSequence, start: int, stop: int) -> None:
        self.whole, self.start, self.stop = whole, start, stop
        self.name = f"{whole.name}_{start}to{stop}"
        self.fingerprint = f"{whole.fingerprint}[{start}:{stop}]"
        self.temporal = whole.temporal

    def __len__(self) -> int:
        return self.stop - self.start

    def frame(self, index: int) -> GreyImage:
        """Frame ``index`` of the range. Raises BadInputError when it cannot be read."""
        return self.whole.frame(self._at(index))

    def frame_name(self, index: int) -> str:
        """What output files of the frame are called."""
        return self.whole.frame_name(self._at(index))

    def camera(self, index: int) -> Camera | None:
        """Intrinsics of the frame."""
        return self.whole.camera(self._at(index))

    def pose(self, index: int) -> FloatArray | None:
        """``T_world_camera`` of the frame."""
        return self.whole.pose(self._at(index))

    def depth(self, index: int) -> FloatArray | None:
        """Depth of the frame (H, W)."""
        return self.whole.depth(self._at(index))

    def right(self, index: int) -> GreyImage | None:
        """Right image of the frame."""
        return self.whole.right(self._at(index))

    def baseline(self) -> float | None:
        """Of the whole sequence."""
        return self.whole.baseline()

    def time(self, index: int) -> float | None:
        """When the frame was taken."""
        return self.whole.time(self._at(index))

    def homography(self, index0: int, index1: int) -> FloatArray | None:
        """(3, 3) from one frame of the range to another."""
        return self.whole.homography(self._at(index0), self._at(index1))

    def _at(self, index: int) -> int:
        if not 0 <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        return self.start + index


def frame_ranges(sequences: Sequence[ImageSequence], start: float, stop: float) -> list[ImageSequence]:
    """The part of each sequence between two fractions of its length; parts of fewer than two frames are left out.

    To train on the beginning of a video and validate on its end: no frame is in both.
    """
    if not 0 <= start < stop <= 1:
        raise BadInputError(f"a range of frames must satisfy 0 <= start < stop <= 1, not {start:g} and {stop:g}")
    ranges = [FrameRange(s, round(start * len(s)), round(stop * len(s))) for s in sequences]
    return [part for part in ranges if len(part) >= 2]


def split_tail(sources: Sequence[Source], fraction: float) -> tuple[list[Source], list[Source]]:
    """Sources for training and for validation: the last ``fraction`` of every sequence is kept for validation."""
    if not 0 < fraction < 1:
        raise BadInputError(f"the fraction of frames kept for validation is {fraction:g}; it must lie between 0 and 1")

    def parts(start: float, stop: float) -> list[Source]:
        cut = [replace(source, sequences=frame_ranges(source.sequences, start, stop)) for source in sources]
        return [source for source in cut if source.sequences]

    return parts(0, 1 - fraction), parts(1 - fraction, 1)

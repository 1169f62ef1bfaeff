"""Views of a sequence: other frames, or frames read another way, with all that is known about them."""

from __future__ import annotations

from collections.abc import Sequence

from sips_lit.errors import BadInputError
from sips_lit.types import Camera, FloatArray, GreyImage, ImageSequence


class SequenceView(ImageSequence):
    """Another sequence, ``whole``, asked about frame ``in_whole(i)`` for frame i; as it stands, a view of all frames."""

    def __init__(self, whole: ImageSequence) -> None:
        self.whole = whole
        self.name, self.fingerprint, self.temporal = whole.name, whole.fingerprint, whole.temporal
        self.damage = whole.damage

    def __len__(self) -> int:
        return len(self.whole)

    def in_whole(self, index: int) -> int:
        """Which frame of the whole sequence is frame ``index``."""
        return index

    def frame(self, index: int) -> GreyImage:
        """Frame ``index`` of the view. Raises BadInputError when it cannot be read."""
        return self.whole.frame(self.in_whole(index))

    def frame_name(self, index: int) -> str:
        """What output files of the frame are called."""
        return self.whole.frame_name(self.in_whole(index))

    def camera(self, index: int) -> Camera | None:
        """Intrinsics of the frame."""
        return self.whole.camera(self.in_whole(index))

    def pose(self, index: int) -> FloatArray | None:
        """``T_world_camera`` of the frame."""
        return self.whole.pose(self.in_whole(index))

    def depth(self, index: int) -> FloatArray | None:
        """Depth of the frame (H, W)."""
        return self.whole.depth(self.in_whole(index))

    def right(self, index: int) -> GreyImage | None:
        """Right image of the frame."""
        return self.whole.right(self.in_whole(index))

    def baseline(self) -> float | None:
        """Of the whole sequence."""
        return self.whole.baseline()

    def time(self, index: int) -> float | None:
        """When the frame was taken."""
        return self.whole.time(self.in_whole(index))

    def notes(self) -> list[str]:
        """Of the whole sequence."""
        return self.whole.notes()

    def homography(self, index0: int, index1: int) -> FloatArray | None:
        """(3, 3) from one frame of the view to another."""
        return self.whole.homography(self.in_whole(index0), self.in_whole(index1))


class FrameRange(SequenceView):
    """Frames ``start`` to ``stop`` (exclusive) of another sequence. Raises IndexError for frames outside."""

    def __init__(self, whole: ImageSequence, start: int, stop: int) -> None:
        super().__init__(whole)
        self.start, self.stop = start, stop
        self.name = f"{whole.name}_{start}to{stop}"
        self.fingerprint = f"{whole.fingerprint}[{start}:{stop}]"

    def __len__(self) -> int:
        return self.stop - self.start

    def in_whole(self, index: int) -> int:
        """``start + index``."""
        if not 0 <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        return self.start + index

    def source_range(self) -> tuple[ImageSequence, int, int]:
        """Where the frames are in the sequence that the whole is a range of, if it is one."""
        source, first, _ = self.whole.source_range()
        return source, first + self.start, first + self.stop


def frame_ranges(sequences: Sequence[ImageSequence], start: float, stop: float) -> list[FrameRange]:
    """The part of each sequence between two fractions of its length; parts of fewer than two frames are left out.

    To train on the beginning of a video and validate on its end: no frame is in both. Raises BadInputError unless
    0 <= start < stop <= 1.
    """
    if not 0 <= start < stop <= 1:
        raise BadInputError(f"a range of frames must satisfy 0 <= start < stop <= 1, not {start:g} and {stop:g}")
    ranges = [FrameRange(s, round(start * len(s)), round(stop * len(s))) for s in sequences]
    return [part for part in ranges if len(part) >= 2]

"""Matching in many images: two files, or each frame of a stream with the one before."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey
from sips_lit.inference.intrinsics import Intrinsics
from sips_lit.inference.match import PairMatcher
from sips_lit.inference.matched_pair import MatchedPair
from sips_lit.inference.streams import Frame, FrameStream, open_stream
from sips_lit.progress import progress


@dataclass(frozen=True, slots=True)
class NamedPair:
    """A matched pair, and what its files are called."""

    name: str
    pair: MatchedPair


class TwoImages(FrameStream):
    """Two image files, named by their stems. Raises BadInputError, while iterating, when one can't be read."""

    total, fps = 2, None

    def __init__(self, path0: Path, path1: Path) -> None:
        self.paths = path0, path1

    def __iter__(self) -> Iterator[Frame]:
        for path in self.paths:
            grey = read_grey(path)
            yield Frame(path.stem, grey, grey, path.name)


def open_images(paths: Sequence[Path], names: str | None = None) -> FrameStream:
    """Two images, or the images of one folder (``names`` as in `open_stream`), or a video.

    Raises BadInputError when there is nothing to read there, or are more than two.
    """
    if len(paths) == 2:
        return TwoImages(*paths)
    if len(paths) != 1:
        raise BadInputError(f"{len(paths)} images were given: give two, or one folder of images, or one video")
    return open_stream(paths[0], False, names)


def match_stream(
    matcher: PairMatcher,
    stream: FrameStream,
    stride: int = 1,
    camera: Intrinsics | Sequence[Intrinsics] | None = None,
) -> Iterator[NamedPair]:
    """Matches frame 0 with frame ``stride``, that one with frame 2 ``stride``, and so on; each is looked at once.

    ``camera`` as in `match`. Memory does not grow with the number of frames. Raises BadInputError for a stride less than 1,
    at the first frame that can't be read, and where there are no two frames to match.
    """
    if stride < 1:
        raise BadInputError(f"stride is {stride}: give how many frames later the partner is, 1 or more")
    before, frames = None, 0
    total = None if stream.total is None else -(-stream.total // stride)
    for frame in progress(islice(stream, 0, None, stride), desc="matching", unit="frame", total=total):
        view, frames = matcher.view(frame.grey), frames + 1
        if before is not None:
            yield NamedPair(f"{before[0]}-{frame.name}", matcher.join(before[1], view, camera))
        before = frame.name, view
    if frames < 2:
        found = "one image" if stream.total == 1 else f"no two frames that are {stride} apart (stride)"
        raise BadInputError(f"there is {found} to match: give two images, a folder of images, or a video")

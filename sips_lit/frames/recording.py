"""Recordings: parts of a data set that are opened one by one, because opening one is slow (a video is decoded)."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, ParamSpec

from sips_lit.errors import BadInputError
from sips_lit.types import ImageSequence

P = ParamSpec("P")


@dataclass(frozen=True, slots=True)
class Recording:
    """A part of a data set: a video file, or one sequence of anything else.

    ``where`` tells it apart from all others; ``open`` gives its sequences, and decodes a video if that was not done.
    """

    where: str
    open: Callable[[], Sequence[ImageSequence]]


class RecordingLoader(Generic[P]):
    """Decorates a function that lists recordings: the result is a loader, which opens all of them and gives the sequences.

    ``recordings`` is the function itself: nothing is opened by it. Loading raises BadInputError when there is no sequence.
    """

    def __init__(self, recordings: Callable[P, list[Recording]]) -> None:
        functools.update_wrapper(self, recordings)
        self.recordings = recordings

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> list[ImageSequence]:
        """The sequences of all recordings."""
        found = self.recordings(*args, **kwargs)
        sequences = [sequence for recording in found for sequence in recording.open()]
        if not sequences:
            places = ", ".join(recording.where for recording in found[:3])
            raise BadInputError(f"{places or 'the data'} has no shot of two frames or more")
        return sequences

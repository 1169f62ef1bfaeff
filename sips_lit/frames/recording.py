"""Recordings: parts of a data set that are opened one by one, because opening one is slow (a video is decoded)."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, ParamSpec

from sips_lit.errors import BadInputError, LeftOutWarning, StorageError, warn_input
from sips_lit.frames.footage import Footage
from sips_lit.progress import progress
from sips_lit.types import ImageSequence

P = ParamSpec("P")


@dataclass(frozen=True, slots=True)
class Recording:
    """A part of a data set: a video file, or one sequence of anything else.

    ``where`` tells it apart from all others; ``open`` gives its sequences, and decodes a video if that was not done;
    ``footage`` tells from its head what that takes, None if that is nothing or can't be told.
    """

    where: str
    open: Callable[[], Sequence[ImageSequence]]
    footage: Callable[[], Footage | None] = lambda: None


class RecordingLoader(Generic[P]):
    """Decorates a function that lists recordings: the result is a loader, which opens all of them and gives the sequences.

    ``recordings`` is the function itself: nothing is opened by it. A recording that can't be opened costs a warning of one
    line, of the kind LeftOutWarning. Loading raises BadInputError when half of them can't, or there is no sequence.
    """

    def __init__(self, recordings: Callable[P, list[Recording]]) -> None:
        functools.update_wrapper(self, recordings)
        self.recordings = recordings

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> list[ImageSequence]:
        """The sequences of all recordings that can be opened."""
        found = self.recordings(*args, **kwargs)
        sequences: list[ImageSequence] = []
        failed: list[str] = []
        for recording in progress(found, desc="opening", unit="recording", total=len(found)):
            try:
                sequences += recording.open()
            except BadInputError as error:
                if len(found) == 1 or isinstance(error, StorageError):
                    raise
                failed.append(str(error))
                if 2 * len(failed) >= len(found):
                    raise BadInputError(
                        f"half of the {len(found)} recordings can't be read; the first: {failed[0]}"
                    ) from error
                warn_input(f"left out: {error}", LeftOutWarning)
        if not sequences:
            places = ", ".join(recording.where for recording in found[:3])
            raise BadInputError(f"{places or 'the data'} has no shot of two frames or more")
        return sequences

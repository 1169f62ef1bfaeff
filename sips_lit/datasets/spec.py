"""What the tools know of a data set: how to recognise it, what it has, how to use it. One ``SPEC`` a loader."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from sips_lit.types import ImageSequence

Part = Literal["right images", "intrinsics", "poses", "depth", "times", "homographies"]
"""What a data set may know of its frames."""
Sign = Callable[[Path], str | None]
"""What marks a data set at a path, in words for a message; None where it is not there."""


def any_of(*patterns: str) -> Sign:
    """A sign: the first of the glob patterns that matches a file or folder."""
    return lambda path: next((match for pattern in patterns if (match := _first(path, pattern))), None)


def at_least(count: int, *patterns: str) -> Sign:
    """A sign: ``count`` of the glob patterns match. Half a data set is recognised, too: its loader says what is missing."""

    def sign(path: Path) -> str | None:
        found = [match for pattern in patterns if (match := _first(path, pattern))]
        return ", ".join(found) if len(found) >= count else None

    return sign


def _first(path: Path, pattern: str) -> str | None:
    match = min(path.glob(pattern), default=None)
    return None if match is None else str(match.relative_to(path))


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetSpec:
    """A data set: ``kind`` is what ``data=`` calls it, ``title`` its name, ``loader`` gives the sequences at a path.

    Recognition: ``signs``, any of which marks its folder; ``rank`` orders the data sets. Files of rank 1 (videos) and 2
    (images) may lie about in any folder: they count where neither the folder nor one below it has a data set of rank 0.
    ``options`` gives the arguments that the loader needs at a path since its defaults are not there, ``parts`` the folders
    of the sequences of a data set that is recognised as a whole; ``family``: the loader also takes a folder of its folders.

    Checks: what every frame ``has``; ``switches`` of the loader that need files of their own; ``videos``: lists the video
    files at a path, if these are all there is: they are decoded to be checked, and the loader takes a ``cache_dir``.

    Use: the ``inliers=`` that its truth allows, the best known first (klt is what ``sips-train`` takes by itself), and
    other ``keys`` that the command line needs.
    """

    kind: str
    title: str
    loader: Callable[..., list[ImageSequence]]
    signs: tuple[Sign, ...]
    rank: int = 0
    options: Callable[[Path], Mapping[str, Any]] = lambda path: {}
    parts: Callable[[Path], tuple[Path, ...]] = lambda path: ()
    family: bool = False
    has: tuple[Part, ...] = ()
    switches: tuple[str, ...] = ()
    videos: Callable[[Path], list[Path]] | None = None
    inliers: tuple[str, ...] = ("klt",)
    keys: tuple[str, ...] = ()

    def sign(self, path: Path) -> str | None:
        """What marks the data set at ``path``, None if it is not there."""
        return next((found for sign in self.signs if (found := sign(path)) is not None), None)

"""Overlap indexes that stay in their files: of ten thousand videos a training holds what it draws from, and counts."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any, Final, Protocol

from sips_lit.errors import BadInputError
from sips_lit.files import write_whole
from sips_lit.pairs.index_file import index_path, load_index
from sips_lit.pairs.overlap import OverlapIndex, OverlapParameters, PartnerCount
from sips_lit.pairs.recent import Recent
from sips_lit.types import ImageSequence

HELD: Final = 1 << 26
"""Bytes of indexes that a process holds."""
NAME: Final = "catalogue.json"
SAVE_AFTER: Final = 2.0
"""Seconds of reading that are worth keeping."""


class PairTable(Protocol):
    """An overlap index, wherever it is: what its partners are counted by, and drawn from once it is `read`."""

    @property
    def unreadable(self) -> Mapping[int, str]:
        """As `OverlapIndex.unreadable`."""

    def __len__(self) -> int: ...

    def count(self, overlap: float, below: float = math.inf) -> PartnerCount:
        """As `OverlapIndex.count`."""

    def read(self) -> OverlapIndex:
        """The index itself. Raises BadInputError when it is in a file that is gone or damaged."""


class Catalogue:
    """What was once read from the indexes in ``folder``, kept beside them: another start does not open their files.

    An entry holds as long as its file has the same size and time. Whatever is wrong with the catalogue's own file, it is
    made anew; several machines may write it, and what one of them loses is read again.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.entries = folder, _read(folder / NAME)
        self.tables: Recent[OverlapIndex] = Recent(HELD, attrgetter("nbytes"))
        self._new: set[str] = set()
        self._saved = time.monotonic()

    def unreadable(self, path: Path, signature: Mapping[str, Any]) -> Mapping[int, str] | None:
        """Frames that can't be read, and why, if the index at ``path`` is known and has this signature; else None."""
        entry = self._valid(path)
        if entry is None or entry["signature"] != _digest(signature):
            return None
        return {int(frame): why for frame, why in entry["unreadable"].items()}

    def add(self, path: Path, signature: Mapping[str, Any], unreadable: Mapping[int, str]) -> None:
        """Takes in an index that is in its file."""
        entry = {"file": _stat(path), "signature": _digest(signature), "counts": {}}
        self._keep(path, entry | {"unreadable": {str(frame): why for frame, why in unreadable.items()}})

    def count(self, index: StoredIndex, overlap: float, below: float) -> PartnerCount:
        """What `OverlapIndex.count` says of an index. Raises BadInputError where it has to be read and can't be.

        The frames before and after are counted with it, since a training asks for them next, to validate on.
        """
        entry, asked = self._valid(index.path), f"{overlap!r}:{below!r}"
        if entry is None:
            return index.load().count(overlap, below)
        if (key := f"{index.start}:{index.stop}:{asked}") not in entry["counts"]:
            whole = index.load_whole()
            for start, stop in ((index.start, index.stop), (0, index.start), (index.stop, len(whole))):
                entry["counts"][f"{start}:{stop}:{asked}"] = asdict(whole.part(start, stop).count(overlap, below))
            self._keep(index.path, entry)
        return PartnerCount(**entry["counts"][key])

    def _valid(self, path: Path) -> dict[str, Any] | None:
        entry = self.entries.get(path.name)
        return entry if entry is not None and entry["file"] == _stat(path) else None

    def _keep(self, path: Path, entry: dict[str, Any]) -> None:
        self.entries[path.name] = entry
        self._new.add(path.name)
        if time.monotonic() - self._saved > SAVE_AFTER:
            self.save()

    def save(self) -> None:
        """Writes what is new beside what others wrote in between, without indexes that are gone."""
        if self._new:
            there = {path.name for path in self.folder.glob("*.overlap.npz")}
            self.entries = {**_read(self.folder / NAME), **self.entries}
            self.entries = {name: entry for name, entry in self.entries.items() if name in there}
            with contextlib.suppress(BadInputError):  # a folder that can only be read serves without a catalogue
                write_whole(self.folder / NAME, json.dumps(self.entries).encode())
        self._new, self._saved = set(), time.monotonic()


@dataclass(frozen=True, slots=True)
class StoredIndex:
    """The overlap index of frames ``start`` to ``stop`` of ``whole``, read from its file whenever it is asked for."""

    whole: ImageSequence
    start: int
    stop: int
    parameters: OverlapParameters
    catalogue: Catalogue

    def __len__(self) -> int:
        return self.stop - self.start

    @property
    def path(self) -> Path:
        """Its file."""
        return index_path(self.catalogue.folder, self.whole)

    @property
    def unreadable(self) -> dict[int, str]:
        """Frames of the range that can't be read, and why."""
        found = self.catalogue.unreadable(self.path, self.parameters.signature(self.whole))
        found = self.read().unreadable if found is None else found
        return {frame - self.start: why for frame, why in found.items() if self.start <= frame < self.stop}

    def count(self, overlap: float, below: float = math.inf) -> PartnerCount:
        """As `OverlapIndex.count`, without reading the file if its catalogue knows."""
        return self.catalogue.count(self, overlap, below)

    def read(self) -> OverlapIndex:
        """The index. Raises BadInputError when its file is gone or damaged."""
        return self.catalogue.tables.get((self.path, self.start, self.stop), self.load)

    def load(self) -> OverlapIndex:
        """As `read`, but it is not held."""
        return self.load_whole().part(self.start, self.stop)

    def load_whole(self) -> OverlapIndex:
        """The index of the whole sequence. Raises BadInputError when its file is gone or damaged."""
        index = load_index(self.path, self.parameters.signature(self.whole))
        if index is None:
            with contextlib.suppress(OSError):
                os.utime(self.path)  # no catalogue vouches for it any more, so that another run measures it
            raise BadInputError(f"the overlap index {self.path} is gone or damaged: run again to measure it once more")
        return index


def _stat(path: Path) -> list[int]:
    """Size and time of a file; nothing if it is not there."""
    try:
        stat = path.stat()
        return [stat.st_size, stat.st_mtime_ns]
    except OSError:
        return []


def _digest(signature: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(signature, sort_keys=True).encode()).hexdigest()[:16]


def _read(path: Path) -> dict[str, dict[str, Any]]:
    try:
        entries = json.loads(path.read_bytes())
        return {name: entry for name, entry in entries.items() if _whole(entry)}
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return {}


def _whole(entry: Any) -> bool:
    """Whether an entry has all that one has."""
    counts = [value for count in entry["counts"].values() for value in (count["frames"], count["pairs"])]
    reasons = [int(frame) for frame in entry["unreadable"]], list(entry["unreadable"].values())
    plain = all(type(value) is int for value in counts) and all(isinstance(why, str) for why in reasons[1])
    return plain and isinstance(entry["signature"], str) and len(entry["file"]) == 2

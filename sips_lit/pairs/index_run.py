"""Indexing of recordings one by one, each machine its share: one that fails stops no other; numbers of all are kept."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Never

import cv2
import numpy as np
from tqdm import tqdm

from sips_lit.errors import BadInputError
from sips_lit.files import make_folder, write_csv, write_whole
from sips_lit.frames.recording import Recording
from sips_lit.pairs.build import measure, measuring_threads, stored_index
from sips_lit.pairs.overlap import OverlapIndex, OverlapParameters
from sips_lit.progress import progress


@dataclasses.dataclass(frozen=True, slots=True)
class IndexedSequence:
    """What an overlap index says: ``points`` of a frame on average, the median ``reach`` in frames, and how many ``pairs``.

    ``unreadable`` frames are left out; ``problem`` tells why the first of them can't be read, or why the recording has no
    index: then ``sequence`` is empty.
    """

    recording: str
    sequence: str
    frames: int = 0
    points: int = 0
    reach: int = 0
    pairs: int = 0
    unreadable: int = 0
    problem: str = ""

    @property
    def failed(self) -> bool:
        """Whether there is no index."""
        return not self.sequence


COLUMNS = [field.name for field in dataclasses.fields(IndexedSequence)]
TABLE = "summary.csv"


def share(recordings: Iterable[Recording], shard: str) -> list[Recording]:
    """Share ``i/n`` of the recordings in the order of ``where``: number i, i + n, i + 2n, ..., counted from 1.

    Every recording is in exactly one of the shares 1/n to n/n. Raises BadInputError for anything but 1 <= i <= n.
    """
    written = re.fullmatch(r"(\d+)/(\d+)", shard)
    number, count = (int(written[1]), int(written[2])) if written else (0, 0)
    if not 1 <= number <= count:
        raise BadInputError(
            f"shard is {shard}: give a part and the number of parts, 1/4, 2/4, 3/4 or 4/4 for four of them"
        )
    return sorted(recordings, key=lambda recording: recording.where)[number - 1 :: count]


def index_recordings(
    recordings: Sequence[Recording], folder: Path, parameters: OverlapParameters, overlap: float, workers: int
) -> Iterator[list[IndexedSequence]]:
    """Indexes what is not up to date in ``folder``, and yields one list a recording, as soon as it is done.

    Pairs are counted that overlap by ``overlap``. Threads work on ``workers`` recordings side by side. After an
    interruption another run finds the sequences that were finished.
    """
    with (
        progress(desc="recordings", unit="recording", total=len(recordings)) as done,
        progress(desc="frames", unit="frame", total=0) as frames,
        measuring_threads(workers, frames.update) as (pool, on_frame),
    ):
        tasks = [pool.submit(_index, r, folder, parameters, overlap, frames, on_frame) for r in recordings]
        for task in as_completed(tasks):
            done.update()
            yield task.result()


def _index(
    recording: Recording,
    folder: Path,
    parameters: OverlapParameters,
    overlap: float,
    frames: tqdm[Never],
    on_frame: Callable[[], None],
) -> list[IndexedSequence]:
    rows: list[IndexedSequence] = []
    try:
        sequences = recording.open()
        if not sequences:
            raise BadInputError(f"{recording.where} has no shot of two frames or more")
        for sequence in sequences:
            whole, start, stop = sequence.source_range()
            index = stored_index(whole, folder, parameters)
            if index is None:
                frames.total = (frames.total or 0) + len(whole)
                index = measure(whole, folder, parameters, on_frame)
            rows.append(_summary(recording.where, sequence.name, index.part(start, stop), overlap))
    except (BadInputError, OSError, cv2.error) as error:  # what a damaged file may raise
        rows.append(IndexedSequence(recording.where, "", problem=" ".join(str(error).split())))
    return rows


def _summary(recording: str, name: str, index: OverlapIndex, overlap: float) -> IndexedSequence:
    reach = index.reach(overlap)
    return IndexedSequence(
        recording,
        name,
        frames=len(index),
        points=int(index.points.mean()) if len(index) else 0,
        reach=int(np.median(reach)) if len(index) else 0,
        pairs=int(reach.sum()),
        unreadable=len(index.unreadable),
        problem=next(iter(index.unreadable.values()), ""),
    )


class ShareSummary:
    """What is known of the recordings of one share, in ``folder/summary-<data>-<i>of<n>.json``.

    ``data``: text that tells data sets apart; ``recordings``: what is in the share now. What an earlier run wrote about
    them stays until it is replaced.
    """

    def __init__(self, folder: Path, data: str, shard: str, recordings: Iterable[str]) -> None:
        digest = hashlib.sha256(data.encode()).hexdigest()[:8]
        self.folder, self.path = folder, folder / f"summary-{digest}-{shard.replace('/', 'of')}.json"
        known = set(recordings)
        self._rows = {name: rows for name, rows in _read(self.path).items() if name in known}

    def add(self, rows: list[IndexedSequence]) -> None:
        """Replaces what is known of a recording."""
        self._rows[rows[0].recording] = rows

    @property
    def rows(self) -> list[IndexedSequence]:
        """In the order of their recordings."""
        return [row for name in sorted(self._rows) for row in self._rows[name]]

    def write(self) -> Path:
        """Writes the file of the share, and the table of all shares that there are now. Returns where the table is."""
        make_folder(self.folder)
        rows = [dataclasses.asdict(row) for row in self.rows]
        write_whole(self.path, (json.dumps(rows, indent=1, ensure_ascii=False) + "\n").encode())
        return write_table(self.folder)


def write_table(folder: Path) -> Path:
    """Makes ``summary.csv`` of the files of all shares; of a recording that is in several the newest counts.

    Other machines may do the same at once: who writes last has seen the files of all.
    """
    while True:
        files = _shares(folder)
        merged: dict[str, list[IndexedSequence]] = {}
        for path, _ in files:
            merged |= _read(path)
        rows = [dataclasses.astuple(row) for name in sorted(merged) for row in merged[name]]
        write_csv(folder / TABLE, [COLUMNS, *rows])
        # else another machine wrote in between, and its table may be the one just replaced
        if _shares(folder) == files:
            return folder / TABLE


def _shares(folder: Path) -> list[tuple[Path, int]]:
    """The files of shares and when they were written, oldest first."""
    found = [(path, path.stat().st_mtime_ns) for path in folder.glob("summary-*of*.json")]
    return sorted(found, key=lambda item: (item[1], item[0]))


def _read(path: Path) -> dict[str, list[IndexedSequence]]:
    """Rows by recording; none if there is no file."""
    rows: dict[str, list[IndexedSequence]] = {}
    try:
        for values in json.loads(path.read_text(encoding="utf-8")):
            row = IndexedSequence(**values)
            if not isinstance(row.recording, str):
                raise TypeError("a recording has no name")
            rows.setdefault(row.recording, []).append(row)
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
        raise BadInputError(f"cannot read the summary {path} ({error}): remove it, it is made again") from error
    return rows

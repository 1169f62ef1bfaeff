"""Indexing of recordings one by one: nothing is kept of a recording but a few numbers, and one that fails stops no other.

Several machines may each take a share of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Never

import cv2
import numpy as np

from sips_lit.errors import BadInputError
from sips_lit.frames.recording import Recording
from sips_lit.pairs.build import measure, stored_index
from sips_lit.pairs.overlap import OverlapIndex, OverlapParameters
from sips_lit.progress import Progress, progress


@dataclass(frozen=True, slots=True)
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
    ):
        pool = ThreadPoolExecutor(max(1, workers))
        try:
            tasks = [pool.submit(_index, r, folder, parameters, overlap, frames) for r in recordings]
            for task in as_completed(tasks):
                done.update()
                yield task.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _index(
    recording: Recording, folder: Path, parameters: OverlapParameters, overlap: float, frames: Progress[Never]
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
                index = measure(whole, folder, parameters, frames.update)
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

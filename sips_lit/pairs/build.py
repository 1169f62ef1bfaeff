"""Overlap indexes as files: built for many sequences in parallel, with progress, each stored as soon as it is done."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from pathlib import Path

from sips_lit.errors import BadInputError
from sips_lit.pairs.index_file import index_path, load_index, save_index
from sips_lit.pairs.overlap import OverlapIndex, OverlapParameters, measure_overlap
from sips_lit.progress import progress
from sips_lit.types import ImageSequence


def build_indexes(
    sequences: Sequence[ImageSequence], folder: str | Path, parameters: OverlapParameters, workers: int = 2
) -> list[OverlapIndex]:
    """The overlap index of each sequence, read from ``folder`` where it is up to date, else measured and stored there.

    Of ranges of frames the whole sequence is measured, once, so that an index serves however it is split. Sequences are
    measured by threads (OpenCV releases the GIL). An interrupted build keeps the sequences that it finished. Raises
    BadInputError when half of the frames of a sequence can't be read or an index can't be written.
    """
    folder = Path(folder)
    ranges = [sequence.source_range() for sequence in sequences]
    wholes = {index_path(folder, whole): whole for whole, _, _ in ranges}
    stored = [(path, stored_index(whole, folder, parameters)) for path, whole in wholes.items()]
    indexes = {path: index for path, index in stored if index is not None}
    missing = [path for path in wholes if path not in indexes]
    total = sum(len(wholes[path]) for path in missing)
    with (
        progress(desc="overlap index", unit="frame", total=total) as bar,
        measuring_threads(workers, bar.update) as (pool, on_frame),
    ):
        measured = pool.map(lambda path: measure(wholes[path], folder, parameters, on_frame), missing)
        indexes.update(zip(missing, measured, strict=True))
    return [indexes[index_path(folder, whole)].part(start, stop) for whole, start, stop in ranges]


@contextlib.contextmanager
def measuring_threads(
    workers: int, on_frame: Callable[[], object]
) -> Iterator[tuple[ThreadPoolExecutor, Callable[[], None]]]:
    """Threads that measure sequences, and what they call after each frame.

    After an error they finish the sequences that they have begun; Ctrl-C and SIGTERM, which may not wait for a video of
    an hour, end them at the next frame.
    """
    pool, stopped = ThreadPoolExecutor(max(1, workers)), threading.Event()

    def step() -> None:
        if stopped.is_set():
            raise CancelledError
        on_frame()

    try:
        yield pool, step
    except BaseException as error:
        if not isinstance(error, Exception):
            stopped.set()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def stored_index(sequence: ImageSequence, folder: Path, parameters: OverlapParameters) -> OverlapIndex | None:
    """The index of a whole sequence in ``folder``, or None if it is not there or not up to date.

    It is not, either, when a frame can be read that could not: a disk may have been away.
    """
    index = load_index(index_path(folder, sequence), parameters.signature(sequence))
    for frame in index.unreadable if index else ():
        with contextlib.suppress(BadInputError):
            sequence.frame(frame)
            return None
    return index


def measure(
    sequence: ImageSequence, folder: Path, parameters: OverlapParameters, on_frame: Callable[[], object]
) -> OverlapIndex:
    """Measures the index of a whole sequence and stores it in ``folder``. Raises BadInputError as `build_indexes` does."""
    index = measure_overlap(sequence, parameters, on_frame)
    save_index(index_path(folder, sequence), index, parameters.signature(sequence))
    return index


def require_readable(indexes: Sequence[OverlapIndex]) -> None:
    """Raises BadInputError when a frame can't be read: numbers of detectors compare only on the same frames."""
    reasons = unreadable_frames(indexes)
    if reasons:
        more = f" (and {len(reasons) - 1} frames more)" if len(reasons) > 1 else ""
        raise BadInputError(f"an evaluation needs every frame, but {reasons[0]}{more}")


def unreadable_frames(indexes: Sequence[OverlapIndex]) -> list[str]:
    """Why frames can't be read, one sentence each."""
    return [why for index in indexes for why in index.unreadable.values()]

"""Overlap indexes as files: built for many sequences in parallel, with progress, each stored as soon as it is done."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from pathlib import Path

from sips_lit.errors import BadInputError
from sips_lit.pairs.index_file import index_path, load_index, save_index
from sips_lit.pairs.overlap import OverlapIndex, OverlapParameters, measure_overlap
from sips_lit.pairs.stored import Catalogue, PairTable, StoredIndex
from sips_lit.progress import progress
from sips_lit.types import ImageSequence


def build_indexes(
    sequences: Sequence[ImageSequence], folder: str | Path, parameters: OverlapParameters, workers: int = 2
) -> list[StoredIndex]:
    """The overlap index of each sequence, in ``folder`` already where it is up to date, else measured and stored there.

    Of ranges of frames the whole sequence is measured, once, so that an index serves however it is split. Sequences are
    measured by threads (OpenCV releases the GIL). An interrupted build keeps the sequences that it finished. Raises
    BadInputError when half of the frames of a sequence can't be read or an index can't be written.
    """
    catalogue = Catalogue(Path(folder))
    ranges = [sequence.source_range() for sequence in sequences]
    wholes = {index_path(catalogue.folder, whole): whole for whole, _, _ in ranges}
    known = progress(wholes.items(), desc="stored indexes", unit="sequence", total=len(wholes))
    missing = [whole for path, whole in known if not _is_stored(path, whole, parameters, catalogue)]
    with (
        progress(desc="overlap index", unit="frame", total=sum(map(len, missing))) as bar,
        measuring_threads(workers, bar.update) as (pool, on_frame),
    ):

        def measured(whole: ImageSequence) -> Mapping[int, str]:
            return measure(whole, catalogue.folder, parameters, on_frame).unreadable

        for whole, unreadable in zip(missing, pool.map(measured, missing), strict=True):
            catalogue.add(index_path(catalogue.folder, whole), parameters.signature(whole), unreadable)
    return [StoredIndex(whole, start, stop, parameters, catalogue) for whole, start, stop in ranges]


def _is_stored(path: Path, whole: ImageSequence, parameters: OverlapParameters, catalogue: Catalogue) -> bool:
    """Whether the index of a whole sequence is up to date; the catalogue learns what was not known of it."""
    signature = parameters.signature(whole)
    unreadable = catalogue.unreadable(path, signature)
    if unreadable is None:
        index = load_index(path, signature)
        if index is None:
            return False
        unreadable = index.unreadable
        catalogue.add(path, signature, unreadable)
    return not _some_can_be_read(whole, unreadable)


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
    return None if index is None or _some_can_be_read(sequence, index.unreadable) else index


def _some_can_be_read(sequence: ImageSequence, frames: Iterable[int]) -> bool:
    for frame in frames:
        with contextlib.suppress(BadInputError):
            sequence.frame(frame)
            return True
    return False


def measure(
    sequence: ImageSequence, folder: Path, parameters: OverlapParameters, on_frame: Callable[[], object]
) -> OverlapIndex:
    """Measures the index of a whole sequence and stores it in ``folder``. Raises BadInputError as `build_indexes` does."""
    index = measure_overlap(sequence, parameters, on_frame)
    save_index(index_path(folder, sequence), index, parameters.signature(sequence))
    return index


def require_readable(indexes: Sequence[PairTable]) -> None:
    """Raises BadInputError when a frame can't be read: numbers of detectors compare only on the same frames."""
    reasons = unreadable_frames(indexes)
    if reasons:
        more = f" (and {len(reasons) - 1} frames more)" if len(reasons) > 1 else ""
        raise BadInputError(f"an evaluation needs every frame, but {reasons[0]}{more}")


def unreadable_frames(indexes: Sequence[PairTable]) -> list[str]:
    """Why frames can't be read, one sentence each."""
    return [why for index in indexes for why in index.unreadable.values()]

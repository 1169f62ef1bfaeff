"""Building the overlap indexes of many sequences: in parallel, with progress, each stored as soon as it is done."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from sips_lit.errors import BadInputError
from sips_lit.pairs.overlap import (
    OverlapIndex,
    OverlapParameters,
    index_path,
    load_index,
    measure_overlap,
    save_index,
)
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
    indexes = {path: stored_index(whole, folder, parameters) for path, whole in wholes.items()}
    missing = [path for path, index in indexes.items() if index is None]
    total = sum(len(wholes[path]) for path in missing)
    with progress(desc="overlap index", unit="frame", total=total) as bar:
        pool = ThreadPoolExecutor(max(1, workers))
        try:
            measured = pool.map(lambda path: measure(wholes[path], folder, parameters, bar.update), missing)
            indexes |= dict(zip(missing, list(measured), strict=True))
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
    parts = []
    for whole, start, stop in ranges:
        index = indexes[index_path(folder, whole)]
        assert index is not None
        parts.append(index if stop - start == len(whole) else index.part(start, stop))
    return parts


def stored_index(sequence: ImageSequence, folder: Path, parameters: OverlapParameters) -> OverlapIndex | None:
    """The index of a whole sequence in ``folder``, or None if it is not there or not up to date.

    It is not, either, when a frame can be read that could not: a disk may have been away.
    """
    index = load_index(index_path(folder, sequence), parameters.signature(sequence))
    return None if index is None or any(_readable(sequence, frame) for frame in index.unreadable) else index


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


def _readable(sequence: ImageSequence, frame: int) -> bool:
    try:
        sequence.frame(frame)
    except BadInputError:
        return False
    return True

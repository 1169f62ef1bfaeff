"""Building the overlap indexes of many sequences: in parallel, with progress, each stored as soon as it is done."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tqdm import tqdm

from sips_lit.tracking.overlap import (
    OverlapIndex,
    OverlapParameters,
    index_path,
    load_index,
    measure_overlap,
    save_index,
)
from sips_lit.types import ImageSequence


def build_indexes(
    sequences: Sequence[ImageSequence], folder: str | Path, parameters: OverlapParameters, workers: int = 2
) -> list[OverlapIndex]:
    """The overlap index of each sequence, read from ``folder`` where it is up to date, else measured and stored there.

    Sequences are measured by threads (OpenCV releases the GIL). An interrupted build keeps the sequences that it finished.
    Raises BadInputError when a frame can't be read or an index can't be written.
    """
    folder = Path(folder)
    stored = [load_index(index_path(folder, s), parameters.signature(s)) for s in sequences]
    missing = [s for s, index in zip(sequences, stored, strict=True) if index is None]
    total = sum(map(len, missing))
    with tqdm(total=total, desc="overlap index", unit="frame", delay=2, disable=not missing) as progress:

        def build(sequence: ImageSequence) -> OverlapIndex:
            index = measure_overlap(sequence, parameters, progress.update)
            save_index(index_path(folder, sequence), index, parameters.signature(sequence))
            return index

        pool = ThreadPoolExecutor(max(1, workers))
        try:
            built = iter(list(pool.map(build, missing)))
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
    return [next(built) if index is None else index for index in stored]

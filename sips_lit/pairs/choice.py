"""Which pairs a benchmark measures: random ones by overlap, the first frame with all others, or a list in a file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, get_args

from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source
from sips_lit.pairs.build import build_indexes, require_readable
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.pairs.pair_file import ListedPair, read_pair_file
from sips_lit.pairs.sampler import SourceSampler

Kind = Literal["random", "first_to_others"]


def choose_pairs(
    sources: Sequence[Source],
    index_folder: str | Path,
    kind: Kind = "random",
    pairs: int = 100,
    overlap: float = 0.5,
    seed: int = 0,
    pairs_file: str | Path | None = None,
    workers: int = 2,
) -> list[ListedPair]:
    """The pairs of a pair set; sequences are counted through all sources.

    ``pairs_file`` wins over everything else. Otherwise ``random``: ``pairs`` different pairs (fewer, if there are not so
    many) of at least ``overlap``, fixed by ``seed``; ``first_to_others``: the first frame of each sequence with each of
    its others (HPatches). Raises BadInputError for impossible numbers when no pair reaches the overlap, and
    when a frame can't be read.
    """
    sequences = [sequence for source in sources for sequence in source.sequences]
    if pairs_file is not None:
        return read_pair_file(pairs_file, sequences)
    if kind not in get_args(Kind):
        raise BadInputError(f"kind is {kind}: give {' or '.join(get_args(Kind))}")
    if kind == "first_to_others":
        return [
            ListedPair(at, 0, index, math.nan)
            for at, sequence in enumerate(sequences)
            for index in range(1, len(sequence))
        ]
    if pairs < 1:
        raise BadInputError(f"pairs is {pairs}: measure at least one")
    indexes = build_indexes(sequences, index_folder, OverlapParameters(), workers)
    require_readable(indexes)
    first_of_source = [sum(len(source.sequences) for source in sources[:at]) for at in range(len(sources))]
    listed = []
    for at, choice in SourceSampler(sources, indexes, overlap, seed).fixed(pairs):
        position = first_of_source[at] + choice.sequence
        early, late = sorted((choice.index0, choice.index1))
        share = float(indexes[position].overlap(early)[late - early - 1])
        listed.append(ListedPair(position, choice.index0, choice.index1, share))
    return listed

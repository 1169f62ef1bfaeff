"""Fixed pair sets: the same random pairs for every detector (paper, pair selection)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source, as_sources
from sips_lit.pairs.build import build_indexes, require_readable
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.pairs.source_pairs import FixedPairs, SourceSampler
from sips_lit.types import FramePair, ImageSequence, InlierCheck


@dataclass(frozen=True, slots=True)
class PairSet:
    """Pairs with the inlier check of each; ``protocol`` says how they were drawn and are verified."""

    pairs: FixedPairs
    checks: list[InlierCheck]
    protocol: dict[str, Any]

    def __len__(self) -> int:
        return len(self.pairs)

    def __iter__(self) -> Iterator[tuple[FramePair, InlierCheck]]:
        for index in range(len(self.pairs)):
            item = self.pairs[index]
            yield item.pair, self.checks[item.source]


def draw_pairs(
    data: Sequence[ImageSequence] | Sequence[Source],
    inliers: InlierCheck,
    index_folder: str | Path,
    pairs: int = 100,
    overlap: float = 0.5,
    seed: int = 0,
    overlap_parameters: OverlapParameters | None = None,
    workers: int = 2,
) -> PairSet:
    """``pairs`` random pairs with at least ``overlap`` (fewer, if the data has not so many), fixed by ``seed``.

    Raises BadInputError when no pair reaches the overlap, or a frame can't be read.
    """
    if pairs < 1:
        raise BadInputError(f"pairs is {pairs}: evaluate on at least one")
    sources = as_sources(data)
    sequences = [sequence for source in sources for sequence in source.sequences]
    indexes = build_indexes(sequences, index_folder, overlap_parameters or OverlapParameters(), workers)
    require_readable(indexes)
    choices = SourceSampler(sources, indexes, overlap, seed).fixed(pairs)
    checks = [source.inliers or inliers for source in sources]
    protocol = {
        "sequences": [sequence.name for sequence in sequences],
        "pairs": len(choices),
        "overlap": overlap,
        "seed": seed,
        "verification": [dict(check.protocol) for check in checks],
    }
    return PairSet(FixedPairs(sources, choices, inliers), checks, protocol)

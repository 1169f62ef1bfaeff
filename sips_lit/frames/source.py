"""Sources: sequences with a weight and, if they have a truth of their own, the inlier check that labels them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from sips_lit.errors import BadInputError
from sips_lit.frames.views import frame_ranges
from sips_lit.types import ImageSequence, InlierCheck

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Source:
    """Sequences that are drawn with probability proportional to ``weight`` among the sources of a mixture.

    ``inliers`` labels the pairs of this source; None leaves that to the run's own inlier check. Raises BadInputError for
    a weight that is not positive.
    """

    sequences: Sequence[ImageSequence]
    weight: float = 1.0
    inliers: InlierCheck | None = None
    name: str = "data"

    def __post_init__(self) -> None:
        if not self.weight > 0:
            raise BadInputError(f"the weight of a source is {self.weight:g}; make it positive, or leave the source out")


def mixture(
    sources: Mapping[str, Source | None], only: Sequence[str] | None = None, without: Sequence[str] = ()
) -> list[Source]:
    """The sources of a mapping by name; those set to null are left out, those not in ``only``, and those in ``without``."""
    return [replace(source, name=name) for name, source in chosen(sources, only, without).items()]


def chosen(sources: Mapping[str, T | None], only: Sequence[str] | None, without: Sequence[str]) -> dict[str, T]:
    """The sources, whatever describes them, that `mixture` takes. Raises BadInputError for a name that none has."""
    for name in [*(only or ()), *without]:
        if name not in sources:
            raise BadInputError(f"the mixture has no source {name}: choose among {', '.join(sources)}")
    names = [name for name in sources if (only is None or name in only) and name not in without]
    return {name: source for name in names if (source := sources[name]) is not None}


def as_sources(data: Sequence[ImageSequence] | Sequence[Source]) -> list[Source]:
    """What ``data=`` gives: the sources of a mixture, or the sequences of one data set as a single source.

    Raises BadInputError when there is no sequence at all.
    """
    sources = [item for item in data if isinstance(item, Source) and item.sequences]
    sequences = [item for item in data if isinstance(item, ImageSequence)]
    if sequences:
        sources.append(Source(sequences))
    if not sources:
        raise BadInputError("the data has no sequence of at least two frames: check data.path")
    return sources


def split_tail(sources: Sequence[Source], fraction: float) -> tuple[list[Source], list[Source]]:
    """Sources for training and for validation: the last ``fraction`` of every sequence is kept for validation."""
    if not 0 < fraction < 1:
        raise BadInputError(f"the fraction of frames kept for validation is {fraction:g}; it must lie between 0 and 1")

    def parts(start: float, stop: float) -> list[Source]:
        cut = [replace(source, sequences=frame_ranges(source.sequences, start, stop)) for source in sources]
        return [source for source in cut if source.sequences]

    return parts(0, 1 - fraction), parts(1 - fraction, 1)

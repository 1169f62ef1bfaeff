"""Which pairs a benchmark measures: random ones by overlap, the first frame with all others, or a list in a file."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from sips_lit.errors import BadInputError, warn_input
from sips_lit.files import make_folder, read_text, write_csv
from sips_lit.frames.source import Source
from sips_lit.pairs.build import build_indexes, require_readable
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.pairs.sampler import SourceSampler
from sips_lit.types import ImageSequence

COLUMNS = ("sequence", "index0", "index1", "overlap", "pixels")
Kind = Literal["random", "first_to_others"]


@dataclass(frozen=True, slots=True)
class ListedPair:
    """Frames ``index0`` and ``index1`` of the sequence at position ``sequence``.

    ``overlap``, and the median distance in ``pixels`` of places of both images, are NaN where unknown.
    """

    sequence: int
    index0: int
    index1: int
    overlap: float
    pixels: float = math.nan


def choose_pairs(
    sources: Sequence[Source],
    index_folder: str | Path,
    kind: Kind = "random",
    pairs: int = 100,
    overlap: float = 0.5,
    overlap_below: float | None = None,
    seed: int = 0,
    pairs_file: str | Path | None = None,
    workers: int = 2,
) -> list[ListedPair]:
    """The pairs of a pair set; sequences are counted through all sources.

    ``pairs_file`` wins over everything else. Otherwise ``random``: ``pairs`` different pairs of at least ``overlap``, and
    less than ``overlap_below``, fixed by ``seed`` (fewer, with a warning, where there are not so many);
    ``first_to_others``: the first frame of each sequence with each of its others (HPatches). Raises BadInputError for
    impossible numbers, when no pair reaches the overlap, and when a frame can't be read.
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
    below = math.inf if overlap_below is None else overlap_below
    for at, choice in SourceSampler(sources, indexes, overlap, seed, below).fixed(pairs):
        position = first_of_source[at] + choice.sequence
        early, late = sorted((choice.index0, choice.index1))
        index = indexes[position].read()
        of_early = index.overlap(early), index.motion_to(early)[:, 0]
        share, pixels = (float(values[late - early - 1]) for values in of_early)
        listed.append(ListedPair(position, choice.index0, choice.index1, share, pixels))
    if len(listed) < pairs:
        less = "" if overlap_below is None else f" and less than {overlap_below:g}"
        warn_input(f"{pairs} pairs are asked for, and only {len(listed)} different ones overlap by {overlap:g}{less}")
    return listed


def write_pair_file(path: Path, sequences: Sequence[ImageSequence], pairs: Sequence[ListedPair]) -> None:
    """Writes a CSV with a row per pair: name of the sequence, both indices, overlap and pixels (empty where unknown)."""
    rows = [
        (sequences[p.sequence].name, p.index0, p.index1, *(None if math.isnan(x) else x for x in (p.overlap, p.pixels)))
        for p in pairs
    ]
    make_folder(path.parent)
    write_csv(path, [COLUMNS, *rows])


def read_pair_file(path: str | Path, sequences: Sequence[ImageSequence]) -> list[ListedPair]:
    """The pairs of a file, in its order.

    A row is ``sequence frame0 frame1``, by commas or spaces, perhaps with overlap and pixels. A frame is given by its name
    or its index (from 0); the columns are indices for sure if the head of the file calls them ``index0`` and ``index1``.
    Empty lines and those that begin with # are passed over. Raises BadInputError with the line that can't be used.
    """
    path = Path(path)
    try:
        lines = read_text(path).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(
            f"the pair list {path} can't be read: {getattr(error, 'strerror', 'it is no text')}"
        ) from error
    by_name = {sequence.name: position for position, sequence in enumerate(sequences)}
    names: dict[int, dict[str, int]] = {}
    only_indices = False
    pairs: list[ListedPair] = []
    for number, line in enumerate(lines, start=1):
        fields = [field.strip() for field in (line.split(",") if "," in line else line.split())]
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if fields[0] == "sequence" and not pairs:
            only_indices = tuple(fields[1:3]) == COLUMNS[1:3]
            continue
        where = f"line {number} of the pair list {path}"
        if len(fields) not in (3, 4, 5):
            raise BadInputError(f"{where} has {len(fields)} fields: give sequence, frame0 and frame1")
        if fields[0] not in by_name:
            has = ", ".join(list(by_name)[:5])
            raise BadInputError(f"{where} names the sequence {fields[0]}, which the data lacks: it has {has}")
        position = by_name[fields[0]]
        if position not in names and not only_indices:
            sequence = sequences[position]
            names[position] = {sequence.frame_name(index): index for index in range(len(sequence))}
        index0, index1 = (_frame(text, sequences[position], names.get(position, {}), where) for text in fields[1:3])
        if index0 == index1:
            raise BadInputError(f"{where} pairs frame {fields[1]} with itself: give two different frames")
        overlap, pixels = (
            _number(fields[at:], where, *of) for at, of in ((3, ("overlap", 1)), (4, ("pixels", math.inf)))
        )
        pairs.append(ListedPair(position, index0, index1, overlap, pixels))
    if not pairs:
        raise BadInputError(f"the pair list {path} has no pairs: give rows of sequence, frame0 and frame1")
    return pairs


def _frame(text: str, sequence: ImageSequence, names: dict[str, int], where: str) -> int:
    if text in names:
        return names[text]
    if re.fullmatch("[0-9]{1,18}", text) and int(text) < len(sequence):
        return int(text)
    raise BadInputError(
        f"{where} names frame {text}, which {sequence.name} lacks: "
        f"it has frames 0 to {len(sequence) - 1}, the first is called {sequence.frame_name(0)}"
    )


def _number(fields: list[str], where: str, what: str, most: float) -> float:
    if not fields or not fields[0]:
        return math.nan
    try:
        number = float(fields[0])
    except ValueError:
        number = -1
    if number < 0 or number > most:
        raise BadInputError(f"{where} has {fields[0]} as its {what}: give a number from 0 to {most:g}, or leave it out")
    return number

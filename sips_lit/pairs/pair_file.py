"""Pair lists as files: what a benchmark wrote, or anybody's list, is the pair set of the next one."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sips_lit.errors import BadInputError
from sips_lit.files import make_folder, write_whole
from sips_lit.types import ImageSequence

COLUMNS = ("sequence", "index0", "index1", "overlap")


@dataclass(frozen=True, slots=True)
class ListedPair:
    """Frames ``index0`` and ``index1`` of the sequence at position ``sequence``; ``overlap`` is NaN where unknown."""

    sequence: int
    index0: int
    index1: int
    overlap: float


def write_pair_file(path: Path, sequences: Sequence[ImageSequence], pairs: Sequence[ListedPair]) -> None:
    """Writes a CSV with a row per pair: name of the sequence, both indices, overlap (empty where unknown)."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for pair in pairs:
        overlap = "" if math.isnan(pair.overlap) else repr(pair.overlap)
        writer.writerow([sequences[pair.sequence].name, pair.index0, pair.index1, overlap])
    make_folder(path.parent)
    write_whole(path, text.getvalue().encode())


def read_pair_file(path: str | Path, sequences: Sequence[ImageSequence]) -> list[ListedPair]:
    """The pairs of a file, in its order.

    A row is ``sequence frame0 frame1``, by commas or spaces, perhaps with the overlap. A frame is given by its name or
    its index (from 0); the columns are indices for sure if the head of the file calls them ``index0`` and ``index1``.
    Empty lines and those that begin with # are passed over. Raises BadInputError with the line that can't be used.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
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
        if len(fields) not in (3, 4):
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
        pairs.append(ListedPair(position, index0, index1, _overlap(fields[3:], where)))
    if not pairs:
        raise BadInputError(f"the pair list {path} has no pairs: give rows of sequence, frame0 and frame1")
    return pairs


def _frame(text: str, sequence: ImageSequence, names: dict[str, int], where: str) -> int:
    if text in names:
        return names[text]
    if text.isascii() and text.isdigit() and int(text) < len(sequence):
        return int(text)
    raise BadInputError(
        f"{where} names frame {text}, which {sequence.name} lacks: "
        f"it has frames 0 to {len(sequence) - 1}, the first is called {sequence.frame_name(0)}"
    )


def _overlap(fields: list[str], where: str) -> float:
    if not fields or not fields[0]:
        return math.nan
    try:
        return float(fields[0])
    except ValueError as error:
        raise BadInputError(f"{where} has {fields[0]} as its overlap: give a number, or leave it out") from error

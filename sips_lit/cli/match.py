"""sips-match: matches of two images, of a folder of images, or of a video, with a homography or a relative pose."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, get_args

from omegaconf import DictConfig
from tabulate import tabulate

from sips_lit.cli.app import build, run, typed
from sips_lit.errors import BadInputError
from sips_lit.inference.intrinsics import read_intrinsics
from sips_lit.inference.match import PairMatcher
from sips_lit.inference.match_stream import NamedPair, match_stream, open_images
from sips_lit.inference.match_writers import MatchFormat, MatchWriter, open_match_writer

SHOWN: Final = 20
"""Pairs in the table that is printed."""


@dataclass
class MatchOptions:
    """The types of ``conf/match.yaml``, which documents the keys."""

    checkpoint: str
    detector: Any
    descriptor: Any
    input: Any
    names: str | None
    stride: int
    n: int
    threshold: float | None
    camera: Any
    output: str
    format: Any


def match(config: DictConfig) -> None:
    """Matches every pair; prints a table and what was written, also when an image cannot be read."""
    options = typed(config, MatchOptions)
    kinds, camera = formats(options.format), cameras(options.camera)
    matcher = PairMatcher(build(config.detector), build(config.descriptor), options.n, options.threshold)
    given = [options.input] if isinstance(options.input, str) else options.input
    if not isinstance(given, list) or not given:
        raise BadInputError(f"input is {given}: give two images, [a.jpg,b.jpg], a folder of images, or a video")
    stream, folder = open_images([Path(str(path)) for path in given], options.names), Path(options.output)
    rows: list[list[Any]] = []
    writers: list[MatchWriter] = []
    with ExitStack() as stack:
        try:
            for named in match_stream(matcher, stream, options.stride, camera):
                for kind in kinds if not rows else ():  # nothing is written of images that can't be matched
                    writers.append(open_match_writer(kind, folder))
                    stack.callback(writers[-1].close)
                for writer in writers:
                    writer.write(named)
                rows.append(row_of(named))
        finally:
            if rows:
                print(table(rows))
                print(f"wrote to {folder}: {', '.join(writer.written for writer in writers)}")


def formats(given: Any) -> list[MatchFormat]:
    """The output formats, of one name or a list of names. Raises BadInputError for unknown ones."""
    names = [given] if isinstance(given, str) else given
    known: tuple[MatchFormat, ...] = get_args(MatchFormat)
    if not isinstance(names, list) or not names or any(name not in known for name in names):
        raise BadInputError(f"format is {given}: give one or several of {', '.join(known)}, like format=[npz,csv]")
    return [kind for kind in known if kind in names]


def cameras(given: Any) -> Any:
    """Nothing, the matrix of one camera, or those of two: ``camera`` as it is typed. Raises BadInputError for others."""
    if given is None:
        return None
    if isinstance(given, list) and len(given) == 2:
        return [read_intrinsics(one) for one in given]
    return read_intrinsics(given)


def row_of(named: NamedPair) -> list[Any]:
    """A pair in the table."""
    pair = named.pair
    counts = len(pair.keypoints0), len(pair.keypoints1)
    points = str(counts[0]) if counts[0] == counts[1] else f"{counts[0]} + {counts[1]}"
    return [named.name, points, len(pair), int(pair.inlier.sum()), pair.model]


def table(rows: Sequence[Sequence[Any]]) -> str:
    """The first pairs, as Markdown."""
    text = tabulate(rows[:SHOWN], ["pair", "points", "matches", "inliers", "model"], "pipe", disable_numparse=True)
    return text if len(rows) <= SHOWN else f"{text}\n... {len(rows)} pairs in all; format=csv writes them to pairs.csv"


main = partial(run, "match", match)

if __name__ == "__main__":
    main()

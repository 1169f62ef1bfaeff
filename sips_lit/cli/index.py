"""sips-index: measures and keeps the overlap of frames."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Final

from hydra.utils import get_object
from omegaconf import DictConfig, OmegaConf
from tabulate import tabulate

from sips_lit.cli.app import build, run
from sips_lit.cli.value_types import refuse_wrong_keys
from sips_lit.errors import BadInputError
from sips_lit.frames.footage import footage_of_all
from sips_lit.frames.recording import Recording
from sips_lit.frames.source import as_sources, chosen
from sips_lit.pairs.index_run import IndexedSequence, ShareSummary, index_recordings, share

KEYS: Final = {"workers": int, "shard": str, "overlap": float}
"""Keys of the command itself, with what they take."""
SAVE_EVERY = 30.0  # seconds between two summaries of a run that goes on
SHOWN = 40  # lines of a table that a terminal can show


def index(config: DictConfig) -> None:
    """Indexes a share of the data, prints one line per sequence and what failed.

    Raises BadInputError at the end when a recording failed.
    """
    refuse_wrong_keys(config, KEYS)
    refuse_wrong_keys(config.paths, {"indexes": Path})
    folder, shard = Path(config.paths.indexes).resolve(), str(config.shard)
    mine = share(recordings(config.data), shard)
    footage = footage_of_all([recording.footage for recording in mine])
    if footage is not None:
        print(footage, flush=True)
    data = str(OmegaConf.to_container(config.data, resolve=True))
    summary = ShareSummary(folder, data, shard, (recording.where for recording in mine))
    saved = time.monotonic()
    try:
        for rows in index_recordings(mine, folder, build(config.overlap_parameters), config.overlap, config.workers):
            summary.add(rows)
            if time.monotonic() - saved > SAVE_EVERY:
                summary.write()
                saved = time.monotonic()
    finally:
        written = summary.write()
    print(report(summary.rows, config.overlap))
    print(f"\nindexes: {folder}\nsummary: {written}")
    failed = [row for row in summary.rows if row.failed]
    if failed:
        raise BadInputError(
            f"{len(failed)} of {len(mine)} recordings failed ({written} has them all), the first: {failed[0].problem}"
        )


def recordings(data: DictConfig) -> list[Recording]:
    """The parts of a data set, or of all those of a mixture: what its loader lists as recordings, so that no video is
    decoded before its turn; else sequences.
    """
    if is_mixture(data):
        taken = chosen(data.sources, data.get("only"), data.get("without") or ())
        return [part for source in taken.values() for part in recordings(source.sequences)]
    target = data.get("_target_")
    if target and lists_recordings(target):
        listed: list[Recording] = build(data, _target_=f"{target}.recordings")
        return listed
    sequences = [sequence for source in as_sources(build(data)) for sequence in source.sequences]
    path = data.get("path")
    place = f"{Path(path).absolute()}:" if isinstance(path, str) else ""
    return [Recording(f"{place}{sequence.name}", partial(list, [sequence])) for sequence in sequences]


def lists_recordings(target: str) -> bool:
    """Whether what is named has a function ``recordings``; not what can't be imported, which making it tells."""
    try:
        return hasattr(get_object(target), "recordings")
    except (ImportError, ValueError):
        return False


def is_mixture(data: DictConfig) -> bool:
    """Whether the data has sources, each with ``sequences`` that are a data set; one set to null is left out."""
    sources = data.get("sources")
    parts = [source for source in sources.values() if source is not None] if isinstance(sources, DictConfig) else []
    return bool(parts) and all(isinstance(part, DictConfig) and "sequences" in part for part in parts)


def report(rows: list[IndexedSequence], overlap: float) -> str:
    """A table of the sequences if they are few, a line of totals if not, and the recordings that failed."""
    indexed, failed = [row for row in rows if not row.failed], [row for row in rows if row.failed]
    headers = ["sequence", "frames", "points per frame", "median reach (frames)", f"pairs of overlap >= {overlap:g}"]
    bad = any(row.unreadable for row in indexed)
    if bad:
        headers.append("unreadable frames")
    table = [
        [row.sequence, row.frames, row.points, row.reach, row.pairs, *([row.unreadable] if bad else [])]
        for row in indexed
    ]
    if len(table) > SHOWN:
        frames, unreadable = (sum(getattr(row, key) for row in indexed) for key in ("frames", "unreadable"))
        text = f"{len(indexed)} sequences, {frames} frames ({unreadable} of them unreadable)"
    else:
        text = tabulate(table, headers=headers, tablefmt="pipe")
    problems = [f"unreadable in {row.sequence}: {row.problem}" for row in indexed if row.unreadable]
    problems += [f"failed: {row.recording}: {row.problem}" for row in failed]
    hidden = [f"... and {len(problems) - SHOWN} more"] if len(problems) > SHOWN else []
    return "\n".join([text, *([""] if problems else []), *problems[:SHOWN], *hidden])


main = partial(run, "index", index)

if __name__ == "__main__":
    main()

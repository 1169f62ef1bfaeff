"""sips-index: measures and keeps the overlap of frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from omegaconf import DictConfig
from tabulate import tabulate

from sips_lit.cli.app import build, run
from sips_lit.frames.source import as_sources
from sips_lit.tracking.build import build_indexes


def index(config: DictConfig) -> None:
    """Builds what is missing and prints one line a sequence."""
    sequences = [sequence for source in as_sources(build(config.data)) for sequence in source.sequences]
    indexes = build_indexes(sequences, config.paths.indexes, build(config.overlap_parameters), config.workers)
    rows = []
    for sequence, overlaps in zip(sequences, indexes, strict=True):
        reach = overlaps.reach(config.overlap)
        rows.append(
            [sequence.name, len(sequence), int(overlaps.points.mean()), int(np.median(reach)), int(reach.sum())]
        )
    headers = [
        "sequence",
        "frames",
        "points a frame",
        "median reach (frames)",
        f"pairs of overlap >= {config.overlap:g}",
    ]
    print(tabulate(rows, headers=headers, tablefmt="pipe"))
    print(f"\nindexes: {Path(config.paths.indexes).resolve()}")


def main() -> None:
    """Entry point."""
    run("index", index)


if __name__ == "__main__":
    main()

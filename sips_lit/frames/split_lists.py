"""Published splits of data sets: which sequences are for training, validation and test."""

from __future__ import annotations

from pathlib import Path

import yaml

from sips_lit.errors import BadInputError

FOLDER = Path(__file__).parent / "splits"


def split_names(dataset: str, split: str) -> list[str]:
    """Names of the sequences of a split, from ``splits/<dataset>.yaml``, in the order of the file.

    Raises BadInputError for a split that the data set does not have.
    """
    with (FOLDER / f"{dataset}.yaml").open(encoding="utf-8") as file:
        splits: dict[str, list[str]] = yaml.safe_load(file)
    if split not in splits:
        raise BadInputError(
            f"{dataset} has no split {split}: choose one of {', '.join(splits)}, or null for everything"
        )
    return [str(name) for name in splits[split] or []]

"""Published splits of data sets: which sequences are for training, validation and test."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

import yaml

from sips_lit.errors import BadInputError
from sips_lit.frames.listing import some_of

T = TypeVar("T")
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


def only_split(dataset: str, there: Mapping[str, T], split: str | None, path: str | Path) -> dict[str, T]:
    """Of the sequences that are there in ``path`` those of a split, in its order; all of them for None or "all".

    Raises BadInputError when one is missing, or the data set has no such split.
    """
    if split in (None, "all"):
        return dict(there)
    wanted = split_names(dataset, str(split))
    missing = [name for name in wanted if name not in there]
    if missing or not wanted:
        raise BadInputError(
            f"data.split={split} needs {some_of(missing) or 'sequences, but names none'}, and {path} has "
            f"{some_of(list(there))}: download what is missing, or set data.split=null for what is there"
        )
    return {name: there[name] for name in wanted}

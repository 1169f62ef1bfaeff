"""What a pair set is called that the user gave no name: by its data set and its sequences."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Final

import hydra
from omegaconf import DictConfig

from sips_lit.datasets.registry import find_specs
from sips_lit.datasets.spec import DatasetSpec
from sips_lit.files import safe_name
from sips_lit.frames.source import Source

_NAMED: Final = 3  # sequences or sources in a title
_LONGEST_KEY: Final = 60  # characters, as it begins the names of files


def name_of_data(node: DictConfig, sources: Sequence[Source]) -> tuple[str, str]:
    """Key and title of what ``node`` describes and ``sources`` hold: ``kitti_01`` and "KITTI odometry: 01".

    The title of a data set is its `SPEC`'s; one without is called like its loader, and a mixture like its sources.
    """
    loader = hydra.utils.get_object(node["_target_"])
    spec = _spec_of(loader)
    if len(sources) > 1 or sources[0].name != "data":
        names = [source.name for source in sources]
        return _key("mixture", "_".join(names) if len(names) <= _NAMED else ""), _listed(names, "sources")
    names = list(dict.fromkeys(sequence.name for sequence in sources[0].sequences if sequence.name))
    kind = getattr(loader, "__name__", "data") if spec is None else spec.kind
    title, listed = kind if spec is None else spec.title, _listed(names, "sequences")
    if len(names) != 1:
        return _key(kind, ""), ": ".join(filter(None, (title, listed)))
    key = names[0] if names[0].startswith(kind) else f"{kind}_{names[0]}"
    return _key(kind, key), title if listed == title else f"{title}: {listed}"


def _listed(names: Sequence[str], what: str) -> str:
    return ", ".join(names) if len(names) <= _NAMED else f"{len(names)} {what}"


def _key(kind: str, own: str) -> str:
    return safe_name(own or kind)[:_LONGEST_KEY]


def _spec_of(loader: object) -> DatasetSpec | None:
    """The description of the data set that ``loader`` reads: a known one, or that in the loader's module."""
    known = next((spec for spec in find_specs() if spec.loader is loader), None)
    found = getattr(sys.modules.get(getattr(loader, "__module__", "")), "SPEC", None)
    return known or (found if isinstance(found, DatasetSpec) and found.loader is loader else None)

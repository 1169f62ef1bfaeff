"""Which data set a folder holds, by the signs of all data sets that are known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sips_lit.datasets.layout import describe_place
from sips_lit.datasets.registry import find_specs
from sips_lit.datasets.spec import DatasetSpec
from sips_lit.errors import BadInputError
from sips_lit.frames.listing import list_folders
from sips_lit.types import ImageSequence

ARCHIVES = (".zip", ".tar", ".gz", ".tgz", ".7z", ".bag")
DEPTH = 3  # levels of folders that are looked into


@dataclass(frozen=True, slots=True)
class DataSet:
    """A data set at ``path``, as its ``spec`` describes it; ``sign`` is what it was recognised by.

    ``options`` are arguments that its loader needs, such as the camera that is there; ``parts``: the folders of its
    sequences, if it has several.
    """

    spec: DatasetSpec
    path: Path
    sign: str
    options: Mapping[str, Any] = field(default_factory=dict)
    parts: tuple[Path, ...] = ()

    def sequences(self, part: Path | None = None, **more: Any) -> list[ImageSequence]:
        """Its sequences, or those of a part; ``more`` are other arguments of the loader. Raises BadInputError."""
        return self.spec.loader(part or self.path, **self.options, **more)


def recognise(path: Path) -> list[DataSet]:
    """The data set at ``path``, or those in its folders.

    Raises BadInputError where nothing is there, or nothing that any loader reads.
    """
    specs = find_specs()
    found = _recognise(path, specs, DEPTH) if path.exists() else []
    if not found:
        packed = sorted(p.name for p in path.iterdir() if p.suffix in ARCHIVES) if path.is_dir() else []
        first = f"unpack {packed[0]} first, or " if packed else ""
        raise BadInputError(
            f"{path} holds no data set that is known here: {describe_place(path)}; {first}give a folder of images, a video, "
            f"or the folder of one of {', '.join(spec.title for spec in specs if not spec.rank)} as it was downloaded"
        )
    return found


def _recognise(path: Path, specs: Sequence[DatasetSpec], depth: int) -> list[DataSet]:
    own = _first(path, (spec for spec in specs if not spec.rank))
    if own:
        return own
    folders = list_folders(path) if depth and path.is_dir() else []
    below = [dataset for folder in folders for dataset in _recognise(folder, specs, depth - 1)]
    if all(dataset.spec.rank for dataset in below):  # else images and videos here are strays
        loose = _first(path, (spec for spec in specs if spec.rank))
        if loose:
            return loose
    return _together(path, below)


def _first(path: Path, specs: Iterable[DatasetSpec]) -> list[DataSet]:
    """The data set of the first spec whose sign is there, if any."""
    for spec in specs:
        sign = spec.sign(path)
        if sign is not None:
            return [DataSet(spec, path, sign, spec.options(path), spec.parts(path))]
    return []


def _together(path: Path, found: list[DataSet]) -> list[DataSet]:
    """The data sets in the folders of ``path``; as one, if they are sequences that one loader takes as a whole."""
    alike = all((d.spec, d.options, d.path.parent) == (found[0].spec, found[0].options, path) for d in found)
    if not found or not found[0].spec.family or not alike:
        return found
    first, *others = found
    more = f" and {len(others)} more" if others else ""
    parts = tuple(dataset.path for dataset in found)
    return [DataSet(first.spec, path, f"{first.path.name}/{first.sign}{more}", first.options, parts)]

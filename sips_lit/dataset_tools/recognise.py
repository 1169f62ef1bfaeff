"""Which data set a folder holds, by the signs of all data sets that are known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sips_lit.datasets.layout import describe_place
from sips_lit.datasets.registry import IMAGES, find_specs
from sips_lit.datasets.spec import DatasetSpec
from sips_lit.errors import BadInputError, warn_input
from sips_lit.frames.image_kind import frames_among, group_of, in_folders
from sips_lit.frames.listing import list_folders, list_images
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
    found = [d for d in _recognise(path, specs, DEPTH) if not _is_depth(d)] if path.exists() else []
    if not found:
        packed = sorted(p.name for p in path.iterdir() if p.suffix in ARCHIVES) if path.is_dir() else []
        first = f"unpack {packed[0]} first, or " if packed else ""
        raise BadInputError(
            f"{path} holds no data set that is known here: {describe_place(path)}; {first}give a folder of images, a video, "
            f"or the folder of one of {', '.join(spec.title for spec in specs if not spec.rank)} as it was downloaded"
        )
    return found


def _is_depth(dataset: DataSet) -> bool:
    """Whether a folder of images has nothing but depth maps, by its name and their bits."""
    folders = dataset.parts or (dataset.path,) if dataset.spec is IMAGES else ()
    groups = [group_of(folder.resolve().name, list_images(folder)) for folder in folders]
    return bool(groups) and all(group.no_frames and min(group.bits, default=8) > 8 for group in groups)


def _recognise(path: Path, specs: Sequence[DatasetSpec], depth: int) -> list[DataSet]:
    own = _first(path, (spec for spec in specs if not spec.rank))
    if own:
        return own
    folders = list_folders(path) if depth and path.is_dir() else []
    below = [dataset for folder in folders for dataset in _recognise(folder, specs, depth - 1)]
    if any(not dataset.spec.rank for dataset in below):  # then images and videos here are strays
        return _together(path, below)
    loose = [dataset for spec in specs if spec.rank for dataset in _first(path, [spec])]
    return _without_strays(loose, below) or _together(path, below)


def _without_strays(loose: list[DataSet], below: list[DataSet]) -> list[DataSet]:
    """Videos and images here and those in folders, by counts: nothing where those here are fewer images.

    Images are strays beside as many videos, their previews, and beside a folder of more images. A single one is no sequence.
    """
    images = next((dataset for dataset in loose if dataset.spec is IMAGES), None)
    others = [dataset for dataset in loose if dataset is not images]
    videos = sum(len(dataset.spec.videos(dataset.path)) for dataset in [*others, *below] if dataset.spec.videos)
    most = max((len(list_images(dataset.path)) for dataset in below if dataset.spec is IMAGES), default=0)
    count = len(list_images(images.path)) if images else 0
    if images and (count > videos or not videos) and count >= most:
        below = [dataset for dataset in below if dataset.spec is not IMAGES]
        return [*others, images, *below]
    return [*others, *below] if others else []


def _first(path: Path, specs: Iterable[DatasetSpec]) -> list[DataSet]:
    """The data set of the first spec whose sign is there, if any."""
    for spec in specs:
        sign = spec.sign(path)
        if sign is not None:
            return [DataSet(spec, path, sign, spec.options(path), spec.parts(path))]
    return []


def _together(path: Path, found: list[DataSet]) -> list[DataSet]:
    """The data sets in the folders of ``path``; as one, if they are sequences that one loader takes as a whole.

    Of folders of images those of the frames, where depth maps or masks are beside them.
    """
    plain = {d.path.name: list_images(d.path) for d in found if d.spec is IMAGES and d.path.parent == path}
    conflict = in_folders(plain)
    if conflict:
        dropped = {group.name for group in conflict} - {group.name for group in frames_among(conflict)}
        said = ", ".join(str(group) for group in conflict if group.name in dropped)
        if said:
            warn_input(f"{path}: {said} are taken for depth maps, masks or copies and not for frames")
        return [d for d in found if d.path.parent != path or d.path.name not in dropped]
    alike = all((d.spec, d.options, d.path.parent) == (found[0].spec, found[0].options, path) for d in found)
    if not found or not found[0].spec.family or not alike:
        return found
    first, *others = found
    more = f" and {len(others)} more" if others else ""
    parts = tuple(dataset.path for dataset in found)
    return [DataSet(first.spec, path, f"{first.path.name}/{first.sign}{more}", first.options, parts)]

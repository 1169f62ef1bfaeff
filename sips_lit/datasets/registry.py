"""The data sets that are known: those of this package, plain images and videos, and those that installed packages offer.

A package offers a data set by an entry point of the group ``sips_lit.datasets`` that leads to its `DatasetSpec`.
"""

from __future__ import annotations

import importlib
import pkgutil
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from sips_lit import datasets
from sips_lit.datasets.spec import DatasetSpec
from sips_lit.errors import BadInputError
from sips_lit.frames.folder import folder, names_of_frames
from sips_lit.frames.listing import VIDEO_SUFFIXES, list_images
from sips_lit.frames.video import find_videos, video

GROUP = "sips_lit.datasets"


def count_images(path: Path) -> str | None:
    """The sign of a folder of images: how many it has."""
    count = len(list_images(path)) if path.is_dir() else 0
    return f"{count} images" if count else None


def count_videos(path: Path) -> str | None:
    """The sign of videos: the name of a video file, or how many a folder has."""
    if path.is_file():
        return path.name if path.suffix.lower() in VIDEO_SUFFIXES else None
    try:
        count = len(find_videos(path))
    except BadInputError:
        return None
    return f"{count} video{'s' * (count > 1)}"


VIDEOS = DatasetSpec(kind="video", title="video", loader=video, signs=(count_videos,), rank=1, videos=find_videos)


def _names_there(path: Path) -> dict[str, str]:
    names = names_of_frames(path)
    return {"names": names} if names else {}


IMAGES = DatasetSpec(
    kind="folder",
    title="folder of images",
    loader=folder,
    signs=(count_images,),
    rank=2,
    options=_names_there,
    family=True,
)


def find_specs() -> list[DatasetSpec]:
    """The data sets in the order in which they are tried: by rank, those of other packages before ours.

    Raises BadInputError for an entry point that can't be loaded, or leads to something else.
    """
    names = [f"{datasets.__name__}.{module.name}" for module in pkgutil.iter_modules(datasets.__path__)]
    ours = [spec for name in names if (spec := getattr(importlib.import_module(name), "SPEC", None))]
    return sorted([*map(_load, entry_points(group=GROUP)), *ours, VIDEOS, IMAGES], key=lambda spec: spec.rank)


def _load(entry_point: EntryPoint) -> DatasetSpec:
    try:
        spec = entry_point.load()
    except Exception as error:  # whatever a module of someone else raises as it is imported
        raise _refused(entry_point, f"can't be loaded ({error!r})") from error
    if not isinstance(spec, DatasetSpec):
        raise _refused(entry_point, f"is {spec!r}, not a DatasetSpec")
    return spec


def _refused(entry_point: EntryPoint, problem: str) -> BadInputError:
    return BadInputError(
        f"the entry point {entry_point.name} = {entry_point.value} of {GROUP} {problem}: mend or uninstall its package"
    )

"""Which data set a folder holds, by the files that only that data set has."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from sips_lit.errors import BadInputError
from sips_lit.frames.images import list_images
from sips_lit.frames.layout import describe_place
from sips_lit.frames.video import VIDEO_SUFFIXES
from sips_lit.types import ImageSequence

DEPTH = 3  # levels of folders that are looked into
ROBOTCAR_CAMERAS = ("stereo/centre", "stereo/left", "stereo/right", "mono_left", "mono_rear", "mono_right")


@dataclass(frozen=True, slots=True)
class DataSet:
    """A data set at ``path``; ``kind`` is what ``data=`` calls it, ``title`` its name, ``sign`` what it was known by."""

    kind: str
    title: str
    path: Path
    sign: str

    def sequences(self) -> list[ImageSequence]:
        """Its sequences, by the loader of its kind (not of videos: these are decoded first). Raises BadInputError."""
        loader = getattr(importlib.import_module(f"sips_lit.frames.{self.kind}"), self.kind)
        found: list[ImageSequence] = loader(self.path)
        return found


def recognise(path: Path) -> list[DataSet]:
    """The data set at ``path``, or those in its folders.

    Raises BadInputError where nothing is there, or nothing that any loader reads.
    """
    found = _recognise(path, DEPTH) if path.exists() else []
    if not found:
        raise BadInputError(
            f"{path} holds no data set that is known here: {describe_place(path)}; give a folder of images, a video, or the "
            f"folder of one of {', '.join(dict.fromkeys(title for _, title, _ in SIGNS))} as it was downloaded"
        )
    return found


def _recognise(path: Path, depth: int) -> list[DataSet]:
    for kind, title, sign_of in SIGNS:
        sign = sign_of(path)
        if sign is not None:
            return [DataSet(kind, title, path, sign)]
    if depth == 0 or not path.is_dir():
        return []
    parts = [_recognise(sub, depth - 1) for sub in _folders(path)]
    found = [dataset for part in parts for dataset in part]
    return [_together(path, found)] if _are_one(found, path) else found


def _are_one(found: list[DataSet], parent: Path) -> bool:
    """Whether the data sets of a folder are sequences of one, which its loader takes as a whole."""
    kinds = {dataset.kind for dataset in found}
    return len(kinds) == 1 and kinds <= FAMILIES and all(dataset.path.parent == parent for dataset in found)


def _together(path: Path, found: list[DataSet]) -> DataSet:
    first = found[0]
    sign = f"{first.path.name}/{first.sign}"
    return DataSet(first.kind, first.title, path, sign if len(found) == 1 else f"{sign} and {len(found) - 1} more")


def _folders(path: Path) -> list[Path]:
    return sorted(sub for sub in path.iterdir() if sub.is_dir() and not sub.name.startswith("."))


def _first(path: Path, *patterns: str) -> str | None:
    """The first file or folder that matches one of the patterns, relative to ``path``."""
    for pattern in patterns:
        match = next(iter(sorted(path.glob(pattern))), None)
        if match is not None:
            return str(match.relative_to(path))
    return None


def _euroc(path: Path) -> str | None:
    return _first(path, "mav0/cam0/sensor.yaml", "cam0/sensor.yaml")


def _kitti(path: Path) -> str | None:
    if (path / "image_0").is_dir() and (path / "calib.txt").is_file():
        return "image_0, calib.txt"
    return _first(path, "sequences/*/image_[02]", "dataset/sequences/*/image_[02]", "[0-9][0-9]/image_[02]")


def _posed_depth(path: Path) -> str | None:
    depth = _first(path, "depth_*.npz")
    return f"poses.txt, {depth}" if depth and (path / "poses.txt").is_file() else None


def _rgbd(path: Path) -> str | None:
    if all((path / part).is_dir() for part in ("color", "depth")) and (path / "poses.txt").is_file():
        return "color, depth, poses.txt"
    return _first(path, "depth.txt") and _first(path, "rgb.txt")


def _tum_mono(path: Path) -> str | None:
    return _first(path, "camera.txt") and _first(path, "images.zip", "pcalib.txt", "times.txt")


def _robotcar(path: Path) -> str | None:
    return _first(path, *ROBOTCAR_CAMERAS)


def _hpatches(path: Path) -> str | None:
    return _first(path, "H_1_2")


def _video(path: Path) -> str | None:
    if path.is_file():
        return path.name if path.suffix.lower() in VIDEO_SUFFIXES else None
    videos = [file.name for file in path.iterdir() if file.suffix.lower() in VIDEO_SUFFIXES]
    return f"{len(videos)} video{'s' * (len(videos) > 1)}" if videos else None


def _folder(path: Path) -> str | None:
    images = len(list_images(path)) if path.is_dir() else 0
    return f"{images} images" if images else None


SIGNS: tuple[tuple[str, str, Callable[[Path], str | None]], ...] = (
    ("euroc", "EuRoC / ASL", _euroc),
    ("kitti", "KITTI odometry", _kitti),
    ("posed_depth", "KITTI raw with poses and depth", _posed_depth),
    ("rgbd", "RGB-D with poses", _rgbd),
    ("tum_mono", "TUM mono", _tum_mono),
    ("robotcar", "Oxford RobotCar", _robotcar),
    ("hpatches", "HPatches sequences", _hpatches),
    ("video", "video", _video),
    ("folder", "folder of images", _folder),
)
"""Kind, title and sign of each, the more particular first."""

FAMILIES = frozenset({"euroc", "rgbd", "tum_mono", "robotcar", "hpatches", "folder"})
"""Kinds whose loader also takes a folder of sequences."""

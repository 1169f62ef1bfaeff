"""Which data set a folder holds, by the files that only that data set has."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sips_lit.datasets.layout import describe_place
from sips_lit.errors import BadInputError
from sips_lit.frames.images import list_images
from sips_lit.frames.video import VIDEO_SUFFIXES
from sips_lit.types import ImageSequence

ARCHIVES = (".zip", ".tar", ".gz", ".tgz", ".7z", ".bag")
DEPTH = 3  # levels of folders that are looked into
KITTI_PLACES = ("", "sequences/[0-9][0-9]/", "dataset/sequences/[0-9][0-9]/", "[0-9][0-9]/")
ROBOTCAR_CAMERAS = ("stereo/centre", "stereo/left", "stereo/right", "mono_left", "mono_rear", "mono_right")


@dataclass(frozen=True, slots=True)
class DataSet:
    """A data set at ``path``; ``kind`` is what ``data=`` calls it, ``title`` its name, ``sign`` what it was known by.

    ``options`` are what its loader must be told, such as the camera that is there; ``parts``: the folders of its sequences,
    if it has several.
    """

    kind: str
    title: str
    path: Path
    sign: str
    options: Mapping[str, Any] = field(default_factory=dict)
    parts: tuple[Path, ...] = ()

    def sequences(self, part: Path | None = None, **more: Any) -> list[ImageSequence]:
        """Its sequences, or those of a part, by the loader of its kind (not of videos: these are decoded first).

        ``more`` are other arguments of the loader. Raises BadInputError.
        """
        room = "frames" if self.kind == "folder" else "datasets"
        loader = getattr(importlib.import_module(f"sips_lit.{room}.{self.kind}"), self.kind)
        found: list[ImageSequence] = loader(part or self.path, **self.options, **more)
        return found


def recognise(path: Path) -> list[DataSet]:
    """The data set at ``path``, or those in its folders.

    Raises BadInputError where nothing is there, or nothing that any loader reads.
    """
    found = _recognise(path, DEPTH) if path.exists() else []
    if not found:
        packed = sorted(p.name for p in path.iterdir() if p.suffix in ARCHIVES) if path.is_dir() else []
        first = f"unpack {packed[0]} first, or " if packed else ""
        raise BadInputError(
            f"{path} holds no data set that is known here: {describe_place(path)}; {first}give a folder of images, a video, "
            f"or the folder of one of {', '.join(title for kind, title, _ in SIGNS if kind not in ('video', 'folder'))} as "
            "it was downloaded"
        )
    return found


def _recognise(path: Path, depth: int) -> list[DataSet]:
    for kind, title, sign_of in SIGNS:
        sign = sign_of(path)
        if sign is not None:
            return [DataSet(kind, title, path, sign, _options(kind, path), _parts(kind, path))]
    if depth == 0 or not path.is_dir():
        return []
    parts = [_recognise(sub, depth - 1) for sub in _folders(path)]
    found = [dataset for part in parts for dataset in part]
    return [_together(path, found)] if _are_one(found, path) else found


def _are_one(found: list[DataSet], parent: Path) -> bool:
    """Whether the data sets of a folder are sequences of one, which its loader takes as a whole."""
    if not found or found[0].kind not in FAMILIES:
        return False
    alike = all((d.kind, d.options) == (found[0].kind, found[0].options) for d in found)
    return alike and all(dataset.path.parent == parent for dataset in found)


def _together(path: Path, found: list[DataSet]) -> DataSet:
    first = found[0]
    sign = f"{first.path.name}/{first.sign}"
    sign = sign if len(found) == 1 else f"{sign} and {len(found) - 1} more"
    return DataSet(first.kind, first.title, path, sign, first.options, tuple(dataset.path for dataset in found))


def _options(kind: str, path: Path) -> dict[str, Any]:
    """What the loader must be told since its defaults are not there."""
    if kind == "robotcar":
        camera = _first(path, *ROBOTCAR_CAMERAS)
        return {"camera": camera} if camera not in (None, ROBOTCAR_CAMERAS[0]) else {}
    if kind == "kitti":
        grey, colour = (_first(path, *(f"{at}image_{n}/*.png" for at in KITTI_PLACES)) for n in (0, 2))
        return {"colour": True} if colour and not grey else {}
    return {}


def _parts(kind: str, path: Path) -> tuple[Path, ...]:
    """The folders of the sequences of a data set that is known as a whole."""
    places = KITTI_PLACES[1:] if kind == "kitti" else ()
    return next((tuple(found) for place in places if (found := sorted(path.glob(place)))), ())


def _some(path: Path, least: int, *patterns: str) -> str | None:
    """What matches the patterns, if ``least`` of them match: half of a data set is known, so that what lacks can be told."""
    found = [match for match in (_first(path, pattern) for pattern in patterns) if match]
    return ", ".join(found) if len(found) >= least else None


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
    return _first(path, "mav0/cam0/sensor.yaml", "mav0", "cam0/sensor.yaml", "cam0/data.csv")


def _kitti(path: Path) -> str | None:
    single = _some(path, 2, *(f"image_{number}" for number in range(4)), "calib.txt")
    parts = (f"{at}{part}" for at in KITTI_PLACES[1:] for part in ("image_[0-3]", "calib.txt"))
    return single or _first(path, *parts, *KITTI_PLACES[1:3], "poses/[0-9][0-9].txt")


def _posed_depth(path: Path) -> str | None:
    return _some(path, 2, "poses.txt", "cam.txt", "depth_*.npz")


def _rgbd(path: Path) -> str | None:
    simple = _some(path, 2, "color", "depth", "poses.txt", "cam.json")
    return simple or _some(path, 2, "rgb.txt", "depth.txt", "groundtruth.txt")


def _tum_mono(path: Path) -> str | None:
    return _some(path, 2, "images.zip", "images", "times.txt", "camera.txt", "pcalib.txt", "vignette.png")


def _robotcar(path: Path) -> str | None:
    return _first(path, *ROBOTCAR_CAMERAS, "stereo.timestamps", "mono_*.timestamps")


def _hpatches(path: Path) -> str | None:
    named = path.name.startswith(("v_", "i_"))  # e1.png: the patches, which are another download
    return _first(path, "H_1_[2-6]", *(("1.ppm", "e1.png") if named else ()))


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

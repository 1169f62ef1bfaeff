"""Features that another program saved: one ``.npz`` an image, or one hloc ``.h5`` of many images."""

from __future__ import annotations

import importlib
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError


@dataclass(frozen=True, slots=True)
class SavedFeatures:
    """N points of one image as saved; everything but ``xy`` (N, 2) may be missing.

    ``score`` (N,), ``scale`` (N,), ``descriptors`` (N, D), ``size`` (W, H) of the image. Pixel (0, 0) is the centre of
    the first pixel: so write LF-Net, hloc (it adds 0.5 only on the way to COLMAP) and sips-detect.
    """

    xy: NDArray[np.float32]
    score: NDArray[np.float32] | None
    scale: NDArray[np.float32] | None
    descriptors: NDArray[Any] | None
    size: tuple[int, int] | None


def open_features(path: str | Path) -> NpzFolder | HlocFile:
    """A folder of npz files, or an h5 file. Raises BadInputError where ``path`` is neither."""
    path = Path(path)
    if path.is_dir():
        return NpzFolder(path)
    if path.is_file():
        return HlocFile(path)
    raise BadInputError(
        f"there are no features {path}: give detector.features, a folder of .npz files or an hloc .h5 file"
    )


class NpzFolder:
    """``a/b.png`` has its features in ``a/b.npz`` or ``a/b.png.npz``.

    Keys: ``keypoints`` (N, 2), ``scores``, ``scales``, ``descriptors`` (N, D), ``image_size`` (W, H), as sips-detect
    writes; or ``kpts`` (N, 2) and ``descs`` (N, D), as LF-Net writes, without scores.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def _file(self, image: PurePosixPath) -> Path | None:
        names = image.with_suffix(".npz"), image.with_name(f"{image.name}.npz")
        return next((path for path in (self.folder / name for name in names) if path.is_file()), None)

    def has(self, image: PurePosixPath) -> bool:
        """Whether there is a file for the image."""
        return self._file(image) is not None

    def read(self, image: PurePosixPath) -> SavedFeatures:
        """The features of an image. Raises BadInputError where the file is damaged or lacks its keys."""
        path = self._file(image)
        if path is None:
            raise BadInputError(f"{self.folder} has no features of {image}: add {image.with_suffix('.npz')}")
        try:
            with np.load(path, allow_pickle=False) as stored:
                held = dict(stored)
        except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise BadInputError(f"{path} can't be read as npz: it is damaged, or of another kind") from error
        own = {"kpts": "keypoints", "descs": "descriptors"}
        return _saved({str(own.get(key, key)): values for key, values in held.items()}, str(path))


class HlocFile:
    """hloc's h5: a group an image, named by its path, with ``keypoints`` (N, 2), ``scores``, ``descriptors`` (D, N)."""

    def __init__(self, path: Path) -> None:
        """Raises BadInputError where h5py is missing or ``path`` is not such a file."""
        self.path = path
        members: list[PurePosixPath] = []
        with self._open() as file:
            file.visit(lambda name: members.append(PurePosixPath(name)))
        self.names = frozenset(member.parent for member in members if member.name == "keypoints")
        if not self.names:
            raise BadInputError(f"{path} holds no keypoints: give a file of local features that hloc wrote")

    def has(self, image: PurePosixPath) -> bool:
        """Whether there is a group for the image."""
        return image in self.names

    def read(self, image: PurePosixPath) -> SavedFeatures:
        """The features of an image. Raises BadInputError where it lacks them."""
        where = f"{image} in {self.path}"
        if not self.has(image):
            raise BadInputError(f"there are no features of {where}: extract them, too")
        with self._open() as file:
            held = {key: np.asarray(values) for key, values in file[str(image)].items()}
        if "descriptors" in held:
            held["descriptors"] = held["descriptors"].T
        return _saved(held, where)

    def _open(self) -> Any:
        try:
            return importlib.import_module("h5py").File(self.path, "r")
        except ImportError as error:
            raise BadInputError(f"{self.path} needs the package h5py: pip install 'sips_lit[baselines]'") from error
        except OSError as error:
            raise BadInputError(f"{self.path} can't be read as h5: it is damaged, or of another kind") from error


def _saved(held: Mapping[str, NDArray[Any]], where: str) -> SavedFeatures:
    """Checks what was read, with ``descriptors`` as (N, D), and gives it our types (hloc saves half precision)."""
    if "keypoints" not in held:
        raise BadInputError(
            f"{where} has no keypoints, only {', '.join(held) or 'nothing'}: give files of local features"
        )
    dimensions = {"keypoints": 2, "scores": 1, "scales": 1, "descriptors": 2}
    arrays = {key: np.asarray(held[key]) for key in dimensions if key in held}
    xy = arrays["keypoints"]
    if any(v.ndim != dimensions[key] or len(v) != len(xy) for key, v in arrays.items()) or xy.shape[1] != 2:
        shapes = ", ".join(f"{key} {values.shape}" for key, values in arrays.items())
        raise BadInputError(f"{where} has arrays that do not belong together ({shapes}): write the file again")
    floats = {key: values.astype(np.float32) for key, values in arrays.items()}
    descriptors = arrays.get("descriptors")
    size = held.get("image_size")
    return SavedFeatures(
        floats["keypoints"],
        floats.get("scores"),
        floats.get("scales"),
        descriptors if descriptors is not None and descriptors.dtype == np.uint8 else floats.get("descriptors"),
        None if size is None else (int(size[0]), int(size[1])),
    )

"""Features that another program saved: one ``.npz`` an image, or one hloc ``.h5`` of many images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sips_lit.archives.h5 import H5File
from sips_lit.archives.npz import read_npz
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


class FeatureFiles(Protocol):
    """Saved features by the name of their image."""

    def has(self, image: PurePosixPath) -> bool:
        """Whether there are features of the image with this path, relative to the folder of images."""
        ...

    def read(self, image: PurePosixPath) -> SavedFeatures:
        """The features of an image. Raises BadInputError where they can't be used."""
        ...


def open_features(path: str | Path) -> FeatureFiles:
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
        own = {"kpts": "keypoints", "descs": "descriptors"}
        return _saved({own.get(key, key): values for key, values in read_npz(path).items()}, str(path))


class HlocFile:
    """hloc's h5: a group an image, named by its path, with ``keypoints`` (N, 2), ``scores``, ``descriptors`` (D, N)."""

    def __init__(self, path: Path) -> None:
        """Raises BadInputError where h5py is missing or ``path`` is not such a file."""
        self.path, self._file = path, H5File(path)
        self.names = frozenset(self._file.groups_with("keypoints"))
        if not self.names:
            raise BadInputError(f"{path} holds no keypoints: give a file of local features that hloc wrote")

    def has(self, image: PurePosixPath) -> bool:
        """Whether there is a group for the image."""
        return str(image) in self.names

    def read(self, image: PurePosixPath) -> SavedFeatures:
        """The features of an image. Raises BadInputError where it lacks them."""
        where = f"{image} in {self.path}"
        if not self.has(image):
            raise BadInputError(f"there are no features of {where}: extract them, too")
        held = self._file.read(str(image), ("keypoints", "scores", "scales", "descriptors", "image_size"))
        if "descriptors" in held:
            held["descriptors"] = held["descriptors"].T
        return _saved(held, where)


def _saved(held: Mapping[str, NDArray[Any]], where: str) -> SavedFeatures:
    """Checks what was read, with ``descriptors`` as (N, D), and gives it our types (hloc saves half precision).

    Positions, scores and scales must be finite: others are of a damaged file. Descriptors may be not: those points are
    dropped and counted, as those of any detector.
    """
    if "keypoints" not in held:
        raise BadInputError(
            f"{where} has no keypoints, only {', '.join(held) or 'nothing'}: give files of local features"
        )
    count = len(held["keypoints"]) if held["keypoints"].ndim else 0
    shapes = {"keypoints": (count, 2), "scores": (count,), "scales": (count,), "image_size": (2,)}
    known = {key: values for key, values in held.items() if key in shapes or key == "descriptors"}
    shapes["descriptors"] = (count, *known["descriptors"].shape[-1:]) if "descriptors" in known else ()
    if any(values.dtype.kind == "U" or values.shape != shapes[key] for key, values in known.items()):
        given = ", ".join(f"{key} {values.shape}" for key, values in known.items())
        raise BadInputError(f"{where} has arrays that do not belong together ({given}): write the file again")
    with np.errstate(over="ignore"):
        single = {key: values.astype(np.float32) for key, values in known.items()}
    for key, values in single.items():
        if key != "descriptors" and not np.isfinite(values).all():
            raise BadInputError(
                f"{where} has {key} that are not finite: it is damaged, or write it without such points"
            )
    binary = "descriptors" in known and known["descriptors"].dtype == np.uint8
    size = single.get("image_size")
    return SavedFeatures(
        single["keypoints"],
        single.get("scores"),
        single.get("scales"),
        known["descriptors"] if binary else single.get("descriptors"),
        None if size is None else (int(size[0]), int(size[1])),
    )

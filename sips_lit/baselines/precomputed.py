"""Features that another program saved, one ``.npz`` an image or one hloc ``.h5``, behind the protocol of a detector."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.archives.h5 import H5File
from sips_lit.archives.npz import npz_members, read_npz
from sips_lit.detect.base import BaseDetector, best_keypoints
from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey
from sips_lit.frames.listing import images_below
from sips_lit.progress import progress
from sips_lit.types import Features, GreyImage, Keypoints, Norm

PARTS: Final = ("keypoints", "scores", "scales", "descriptors", "image_size")
"""What may be saved of an image; anything else is not read."""


class PrecomputedDetector(BaseDetector):
    """Saved features, looked up by what an image shows: detectors are given pixels, not names.

    All images below ``images`` that have features are read once, at the start. An image must be given as it is in its
    file (grey, full size). Files without scores (LF-Net's) are in an order that says nothing: ``scores`` is none then,
    and only all points of an image can be had.
    """

    def __init__(self, features: str | Path, images: str | Path, name: str = "precomputed") -> None:
        """``features``: a folder of npz files or an hloc h5 file, named like the images below the folder ``images``.

        Raises BadInputError where either is missing, no names agree, or files can't be used.
        """
        self.name = name
        self.files, self.images = open_features(features), Path(images)
        if not self.images.is_dir():
            raise BadInputError(
                f"there is no folder {images} of the images that {features} belongs to: give detector.images"
            )
        every = [PurePosixPath(path.relative_to(self.images)) for path in sorted(images_below(self.images))]
        names = [image for image in every if self.files.has(image)]
        if not names:
            example = f", such as {every[0]}" if every else ""
            raise BadInputError(
                f"{features} has features of none of the {len(every)} images below {images}{example}: features must be "
                "named like the images"
            )
        with ThreadPoolExecutor() as pool:
            found = pool.map(lambda image: _key(read_grey(self.images / image)), names)
            keys = progress(found, desc=f"images of {name}", unit="image", total=len(names))
            self.image_of: dict[bytes, PurePosixPath] = {}
            for key, image in zip(keys, names, strict=True):
                self.image_of.setdefault(key, image)
        first = self.files.read(names[0])
        self.scores = "none" if first.scores is None else "order"
        self.describes = first.descriptors is not None

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        """At most ``n`` points, best first; all of them in the order of the file where it has no scores.

        Raises BadInputError for an image of which nothing is saved, and for more than ``n`` points without scores.
        """
        return self._look_up(image, n)[0]

    def detect_and_describe(self, image: GreyImage, n: int) -> Features:
        """As `detect`. Raises TypeError where the files have no descriptors."""
        if not self.describes:
            raise TypeError(f"{self.name} has no descriptors: detect, then describe the points.")
        keypoints, rows, saved = self._look_up(image, n)
        assert saved.descriptors is not None  # as in the first file
        norm: Norm = "hamming" if saved.descriptors.dtype == np.uint8 else "l2"
        return Features(keypoints, saved.descriptors[rows], norm)

    def _look_up(self, image: GreyImage, n: int) -> tuple[Keypoints, NDArray[np.int64], SavedFeatures]:
        name = self.image_of.get(_key(image))
        height, width = image.shape
        if name is None:
            raise BadInputError(
                f"an image of {width} x {height} pixels is none of the {len(self.image_of)} below {self.images} that have "
                "features: give the images as the features were computed on (no max_side), and features of all of them"
            )
        saved = self.files.read(name)
        if saved.image_size not in (None, (width, height)):
            raise BadInputError(
                f"the features of {name} are of an image of size {saved.image_size}, not {(width, height)}"
            )
        if (saved.scores is not None, saved.descriptors is not None) != (self.scores == "order", self.describes):
            raise BadInputError(
                f"the features of {name} have other parts than those of the first image: write them again"
            )
        count = len(saved.keypoints)
        if saved.scores is None and count > n:
            raise BadInputError(
                f"the features of {name} are {count} points without scores, so the {n} best are not known: ask for "
                f"all (n_max={count}), or save at most {n}"
            )
        score = 1 / np.arange(1, count + 1) if saved.scores is None else saved.scores
        scale = np.ones(count) if saved.scales is None else saved.scales
        return *best_keypoints(saved.keypoints, score, scale, n), saved


def _key(image: GreyImage) -> bytes:
    return hashlib.blake2b(image.tobytes() + repr(image.shape).encode(), digest_size=16).digest()


@dataclass(frozen=True, slots=True)
class SavedFeatures:
    """N points of one image as saved; everything but ``keypoints`` (N, 2) may be missing.

    ``scores`` (N,), ``scales`` (N,), ``descriptors`` (N, D), ``image_size`` (W, H). Pixel (0, 0) is the centre of the
    first pixel: so write LF-Net, hloc (it adds 0.5 only on the way to COLMAP) and sips-detect.
    """

    keypoints: NDArray[np.float32]
    scores: NDArray[np.float32] | None = None
    scales: NDArray[np.float32] | None = None
    descriptors: NDArray[Any] | None = None
    image_size: tuple[int, int] | None = None


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
        own = {key: key for key in PARTS} | {"kpts": "keypoints", "descs": "descriptors"}
        there = npz_members(path)
        if not {"keypoints", "kpts"} & there.keys():
            raise BadInputError(
                f"{path} has no keypoints, only {', '.join(there) or 'nothing'}: give files of local features"
            )
        return _saved({own[key]: values for key, values in read_npz(path, own).items()}, str(path))


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
        """The features of an image that it has. Raises BadInputError where they can't be used."""
        held = self._file.read(str(image), PARTS)
        if "descriptors" in held:
            held["descriptors"] = held["descriptors"].T
        return _saved(held, f"{image} in {self.path}")


def _saved(held: Mapping[str, NDArray[Any]], where: str) -> SavedFeatures:
    """Checks what was read, with ``descriptors`` as (N, D), and gives it our types (hloc saves half precision).

    Positions, scores and scales must be finite: others are of a damaged file. Descriptors may be not: those points are
    dropped and counted, as those of any detector.
    """
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

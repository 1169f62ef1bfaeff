"""Points that another program found beforehand, behind the protocol of a detector."""

from __future__ import annotations

import hashlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from sips_lit.baselines.feature_files import SavedFeatures, open_features
from sips_lit.detect.base import BaseDetector
from sips_lit.detect.ranking import best_keypoints, ranked
from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey
from sips_lit.frames.listing import images_below
from sips_lit.progress import progress
from sips_lit.types import Features, GreyImage, Keypoints, Norm


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
        below = sorted(images_below(self.images))
        names = [PurePosixPath(path.relative_to(self.images)) for path in below]
        names = [image for image in names if self.files.has(image)]
        if not names:
            example = f", such as {below[0].relative_to(self.images)}" if below else ""
            raise BadInputError(
                f"{features} has features of none of the {len(below)} images below {images}{example}: features must be "
                "named like the images"
            )
        with ThreadPoolExecutor() as pool:
            keys = progress(pool.map(self._key_of, names), desc=f"images of {name}", unit="image", total=len(names))
            self.image_of: dict[bytes, PurePosixPath] = {}
            for key, image in zip(keys, names, strict=True):
                self.image_of.setdefault(key, image)
        first = self.files.read(names[0])
        self.scores = "none" if first.score is None else "order"
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
        if saved.size not in (None, (width, height)):
            raise BadInputError(f"the features of {name} are of an image of size {saved.size}, not {(width, height)}")
        if (saved.score is not None, saved.descriptors is not None) != (self.scores == "order", self.describes):
            raise BadInputError(
                f"the features of {name} have other parts than those of the first image: write them again"
            )
        count = len(saved.xy)
        if saved.score is None and count > n:
            raise BadInputError(
                f"the features of {name} are {count} points without scores, so the {n} best are not known: ask for "
                f"all (n_max={count}), or save at most {n}"
            )
        score = 1 / np.arange(1, count + 1) if saved.score is None else saved.score
        scale = np.ones(count) if saved.scale is None else saved.scale
        rows = ranked(saved.xy, np.asarray(score, np.float32), n)
        return best_keypoints(saved.xy, score, scale, n), rows, saved

    def _key_of(self, image: PurePosixPath) -> bytes:
        return _key(read_grey(self.images / image))


def _key(image: GreyImage) -> bytes:
    content = hashlib.blake2b(image.tobytes(), digest_size=16)
    content.update(repr(image.shape).encode())
    return content.digest()

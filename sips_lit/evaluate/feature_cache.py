"""Features on disk: each image is detected and described once, whatever is then measured, in this run or a later one."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from sips_lit.detect.sanitise import Defects
from sips_lit.evaluate.features import ImageFeatures, extract
from sips_lit.evaluate.method import Method
from sips_lit.files import make_folder, write_whole
from sips_lit.types import Features, GreyImage, Keypoints


class FeatureCache:
    """Features of a method in ``folder``, one file per image, named by the image's content; without a folder none is kept.

    Another detector, descriptor, setting, weight, library version or ``n`` is another folder, so nothing stale is ever
    read. A file is written whole or not at all; a damaged one is computed again. Thread-safe where the detector is.
    """

    def __init__(self, folder: str | Path | None, method: Method, n: int) -> None:
        self.method, self.n = method, n
        text = json.dumps({**method.signature, "n": n}, sort_keys=True, default=str)
        self.folder = (
            None if folder is None else Path(folder) / f"{method.key}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
        )
        self._signature = text
        self._warm = False

    def __call__(self, key: str, image: Callable[[], GreyImage]) -> ImageFeatures:
        """Features of the image with content ``key`` (see `image_key`); ``image`` reads it, if that is necessary."""
        if self.folder is None:
            return self._compute(image())
        path = self.folder / f"{key}.npz"
        stored = _load(path)
        if stored is None:
            stored = self._compute(image())
            if not (self.folder / "signature.json").exists():
                make_folder(self.folder)
                write_whole(self.folder / "signature.json", self._signature.encode())
            write_whole(path, _as_bytes(stored))
        return stored

    def _compute(self, image: GreyImage) -> ImageFeatures:
        if not self._warm:  # the first call loads libraries and compiles: no time to report
            self._warm = True
            extract(self.method.detector, self.method.descriptor, image, self.n)
        return extract(self.method.detector, self.method.descriptor, image, self.n)


def image_key(image: GreyImage) -> str:
    """A hash of the content of an image (H, W)."""
    salt = "x".join(map(str, image.shape)).encode()[:16]
    return hashlib.blake2b(np.ascontiguousarray(image).data, digest_size=16, salt=salt).hexdigest()


def _as_bytes(entry: ImageFeatures) -> bytes:
    content, f = io.BytesIO(), entry.features
    about = {"norm": f.norm, "defects": asdict(entry.defects), "milliseconds": entry.milliseconds}
    np.savez(
        content,
        xy=f.keypoints.xy,
        score=f.keypoints.score,
        scale=f.keypoints.scale,
        descriptors=f.descriptors,
        about=np.array(json.dumps(about)),
    )
    return content.getvalue()


def _load(path: Path) -> ImageFeatures | None:
    try:
        with np.load(path, allow_pickle=False) as stored:
            about: dict[str, Any] = json.loads(str(stored["about"]))
            keypoints = Keypoints(stored["xy"], stored["score"], stored["scale"])
            features = Features(keypoints, stored["descriptors"], about["norm"])
            if not len(keypoints.xy) == len(keypoints.score) == len(keypoints.scale) == len(features.descriptors):
                return None
            return ImageFeatures(features, Defects(**about["defects"]), dict(about["milliseconds"]))
    except Exception:  # a damaged zip file can raise almost anything, and features can always be computed again
        return None

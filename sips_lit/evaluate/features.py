"""Features of an image: a detector's points with its own or another descriptor, sanitised, timed, and kept on disk.

So each image is detected and described once, whatever is then measured, in this run or a later one.
"""

from __future__ import annotations

import hashlib
import io
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sips_lit.detect.sanitise import Defects, sanitise
from sips_lit.errors import BadInputError
from sips_lit.evaluate.method import Method
from sips_lit.files import make_folder, write_whole
from sips_lit.geometry.projection import View
from sips_lit.types import Descriptor, Detector, DisparityMatcher, Features, GreyImage, Keypoints


@dataclass(frozen=True, slots=True)
class ImageFeatures:
    """Legal features of an image, what was wrong with them before, and how long they took when they were computed.

    ``milliseconds``: of ``detect``, of ``describe`` unless the detector describes its points itself, and of ``depth``.
    """

    features: Features
    defects: Defects
    milliseconds: dict[str, float]


def extract(detector: Detector, descriptor: Descriptor | None, image: GreyImage, n: int) -> ImageFeatures:
    """At most ``n`` features of ``image`` (H, W), best first, described by ``descriptor`` or, without one, by the detector.

    What the detector returns is sanitised. Raises BadInputError when there is no descriptor and the detector has none of
    its own, and for arrays that do not belong together.
    """
    begin = time.perf_counter()
    if descriptor is None:
        if not detector.describes:
            raise BadInputError(
                f"{detector.name} finds points but does not describe them: choose descriptor=rootsift, say"
            )
        own, defects = sanitise(detector.detect_and_describe(image, n), image.shape, n)
        return ImageFeatures(own, defects, {"detect": 1e3 * (time.perf_counter() - begin)})
    keypoints, defects = sanitise(detector.detect(image, n), image.shape, n)
    detected = time.perf_counter()
    descriptors = descriptor.describe(image, keypoints)
    milliseconds = {"detect": 1e3 * (detected - begin), "describe": 1e3 * (time.perf_counter() - detected)}
    return ImageFeatures(Features(keypoints, descriptors, descriptor.norm), defects, milliseconds)


def with_depth(found: ImageFeatures, view: View | None, stereo: DisparityMatcher) -> ImageFeatures:
    """The same with the depth of the keypoints, as far as the view of their frame tells it."""
    if view is None or not view.has_depth:
        return found
    begin = time.perf_counter()
    keypoints = replace(found.features.keypoints, depth=view.depth_of(found.features.keypoints, stereo))
    milliseconds = found.milliseconds | {"depth": 1e3 * (time.perf_counter() - begin)}
    return replace(found, features=replace(found.features, keypoints=keypoints), milliseconds=milliseconds)


class FeatureCache:
    """Features of a method in ``folder``, one file per image, named by the image's content; without a folder none is kept.

    Another detector, descriptor, setting, weight, library version or ``n`` is another folder, so nothing stale is ever
    read. A file is written whole or not at all; a damaged one is computed again. Thread-safe where the detector is.
    """

    def __init__(self, folder: str | Path | None, method: Method, n: int) -> None:
        self.method, self.n = method, n
        self._signature = json.dumps({**method.signature, "n": n}, sort_keys=True, default=str).encode()
        digest = hashlib.sha256(self._signature).hexdigest()[:16]
        self.folder = None if folder is None else Path(folder) / f"{method.key}-{digest}"
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
                write_whole(self.folder / "signature.json", self._signature)
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
    arrays: dict[str, Any] = {
        "xy": f.keypoints.xy,
        "score": f.keypoints.score,
        "scale": f.keypoints.scale,
        "descriptors": f.descriptors,
    }
    if f.keypoints.covariance is not None:
        arrays["covariance"] = f.keypoints.covariance
    np.savez(content, about=np.array(json.dumps(about)), **arrays)
    return content.getvalue()


def _load(path: Path) -> ImageFeatures | None:
    try:
        with np.load(path, allow_pickle=False) as stored:
            about: dict[str, Any] = json.loads(str(stored["about"]))
            keypoints = Keypoints(stored["xy"], stored["score"], stored["scale"], None, stored.get("covariance"))
            features = Features(keypoints, stored["descriptors"], about["norm"])
            if not len(keypoints.xy) == len(keypoints.score) == len(keypoints.scale) == len(features.descriptors):
                return None
            return ImageFeatures(features, Defects(**about["defects"]), dict(about["milliseconds"]))
    except Exception:  # a damaged zip file can raise almost anything, and features can always be computed again
        return None

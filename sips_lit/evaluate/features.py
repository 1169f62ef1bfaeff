"""Features of an image: a detector's points with its own or another descriptor, sanitised and timed."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from sips_lit.detect.sanitise import Defects, sanitise
from sips_lit.errors import BadInputError
from sips_lit.geometry.projection import View
from sips_lit.types import Descriptor, Detector, DisparityMatcher, Features, GreyImage


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

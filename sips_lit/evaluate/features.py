"""Features of an image: a detector's points with its own or another descriptor."""

from __future__ import annotations

from sips_lit.baselines.precomputed import PrecomputedDetector
from sips_lit.errors import BadInputError
from sips_lit.types import Descriptor, Detector, Features, GreyImage


def has_scores(detector: Detector) -> bool:
    """Whether the points have an order: those that other programs saved may have none."""
    return not isinstance(detector, PrecomputedDetector) or detector.scored


def extract(detector: Detector, descriptor: Descriptor | None, image: GreyImage, n: int) -> Features:
    """At most ``n`` features of ``image`` (H, W), best first, described by ``descriptor`` or, without one, by the detector.

    Raises BadInputError when there is no descriptor and the detector has none of its own.
    """
    if descriptor is None:
        if not detector.describes:
            raise BadInputError(
                f"{detector.name} finds points but does not describe them: choose descriptor=rootsift, say"
            )
        return detector.detect_and_describe(image, n)
    keypoints = detector.detect(image, n)
    return Features(keypoints, descriptor.describe(image, keypoints), descriptor.norm)

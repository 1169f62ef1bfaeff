"""Where the milliseconds of an image go, for several methods on the same images in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import cv2
import numpy as np

from sips_lit.detect.steps import now, recorded_steps
from sips_lit.evaluate.method import Method
from sips_lit.matching.mutual_nearest import distances, mutual_nearest
from sips_lit.progress import progress
from sips_lit.types import Features, GreyImage

DETECTION: Final = ("network", "suppression", "sub-pixel", "top n")
"""Parts of a detection that our detector tells; the last is the rest of it."""
STEPS: Final = ("points", *DETECTION, "describe", "match")


@dataclass(frozen=True, slots=True)
class Speed:
    """What a method takes: milliseconds per image of each of `STEPS` that it has, one number for each round.

    ``points``: from image to points, with descriptors where they are the detector's own. ``match``: with the next image.
    ``found``: points per image.
    """

    key: str
    name: str
    found: float = 0.0
    milliseconds: dict[str, list[float]] = field(default_factory=dict)

    def median(self, step: str) -> float | None:
        """Over the rounds; None for a step that the method does not have."""
        return float(np.median(self.milliseconds[step])) if step in self.milliseconds else None

    def least(self, step: str) -> float | None:
        """Of the rounds: what other work of the machine disturbs least."""
        return min(self.milliseconds[step]) if step in self.milliseconds else None


def measure_speed(methods: Sequence[Method], images: Sequence[GreyImage], n: int, rounds: int) -> list[Speed]:
    """Each method on each image, ``rounds`` times after one that does not count, the methods in turn in each round.

    In turn, so that what else the machine does meets them all.
    """
    speeds = [Speed(method.key, method.name) for method in methods]
    turns = [(turn, index) for turn in range(rounds + 1) for index in range(len(methods))]
    for turn, index in progress(turns, desc="speed", unit="turn"):
        times, found = _one_round(methods[index], images, n)
        speeds[index] = replace(speeds[index], found=found)
        for name in STEPS if turn > 0 else ():
            if name in times:
                speeds[index].milliseconds.setdefault(name, []).append(times[name])
    return speeds


def _one_round(method: Method, images: Sequence[GreyImage], n: int) -> tuple[dict[str, float], float]:
    """Milliseconds per image of each step, and points per image."""
    total: dict[str, float] = {}
    features = []
    for image in images:
        times, described = _one_image(method, image, n)
        features.append(described)
        for name, taken in times.items():
            total[name] = total.get(name, 0.0) + taken
    start = now()
    for first, second in zip(features, [*features[1:], features[0]], strict=True):
        mutual_nearest(distances(first, second))
    total["match"] = now() - start
    points = sum(map(len, features)) / len(images)
    return {name: taken / len(images) for name, taken in total.items()}, points


def _one_image(method: Method, image: GreyImage, n: int) -> tuple[dict[str, float], Features]:
    detector, descriptor = method.detector, method.descriptor
    with recorded_steps() as steps:
        start = now()
        if descriptor is None:
            features = detector.detect_and_describe(image, n)
            times = {"points": now() - start}
        else:
            keypoints = detector.detect(image, n)
            times = {"points": now() - start}
            start = now()
            features = Features(keypoints, descriptor.describe(image, keypoints), descriptor.norm)
            times["describe"] = now() - start
    if steps:
        steps["top n"] = times["points"] - sum(steps.values())
    return {**times, **steps}, features


def synthetic_image(size: tuple[int, int]) -> GreyImage:
    """A grey image (H, W) of ``size`` (W, H) with structure of several scales: noise, blurred and added."""
    noise = np.random.default_rng(0).standard_normal(size[::-1])
    layers = sum(cv2.GaussianBlur(noise, (0, 0), sigma) * sigma for sigma in (1.5, 3, 6))
    return np.clip(127 + 60 * layers, 0, 255).astype(np.uint8)

"""Evaluation of one detector on one pair set: succinctness and, for probabilities, calibration."""

from __future__ import annotations

import hashlib
import importlib.metadata
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch
from tqdm import tqdm

from sips_lit.detect.detector import SipsDetector
from sips_lit.errors import BadInputError
from sips_lit.evaluate.features import extract, has_scores
from sips_lit.evaluate.pairs import PairSet
from sips_lit.evaluate.result import NO_SCORES
from sips_lit.inliers.point_labels import point_labels
from sips_lit.inliers.verification import Search, VerifiedPair, verify
from sips_lit.inliers.verifier import all_or_none
from sips_lit.metrics.calibration import Calibration, CalibrationResult
from sips_lit.metrics.succinctness import Succinctness, SuccinctnessResult
from sips_lit.types import Descriptor, Detector, Features, GreyImage


@dataclass(frozen=True, slots=True)
class PairRow:
    """What one pair gave: n_k (None = failure), and points, matches and inliers at n_max."""

    pair: str
    n_k: int | None
    points0: int
    points1: int
    matches: int
    inliers: int


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Results of a detector on a pair set with the protocol that they were obtained by."""

    name: str
    protocol: dict[str, Any]
    succinctness: SuccinctnessResult
    calibration: CalibrationResult | None
    rows: list[PairRow]


class FeatureCache:
    """Features of each different image once, by the image's content."""

    def __init__(self, detector: Detector, descriptor: Descriptor | None, n: int) -> None:
        self.detector, self.descriptor, self.n = detector, descriptor, n
        self._known: dict[bytes, Features] = {}

    def __call__(self, image: GreyImage) -> Features:
        """Features of ``image`` (H, W), computed if they are new."""
        key = hashlib.blake2b(image.tobytes(), digest_size=16, salt=str(image.shape).encode()[:16]).digest()
        if key not in self._known:
            self._known[key] = extract(self.detector, self.descriptor, image, self.n)
        return self._known[key]


def evaluate(
    detector: Detector,
    descriptor: Descriptor | None,
    pairs: PairSet,
    k: int = 10,
    n_max: int = 200,
    search: Search = "auto",
    name: str | None = None,
) -> Evaluation:
    """Succinctness of a detector with a descriptor (None = its own) over a pair set, and calibration of probabilities.

    Raises BadInputError for what the detector, the descriptor or the inlier check can't do, and for impossible numbers.
    """
    if not 1 <= k < n_max:
        raise BadInputError(f"k is {k} and n_max is {n_max}: ask for at least one inlier, within more points than that")
    name = name or detector.name + ("" if descriptor is None else f" + {descriptor.name}")
    features_of, scored = FeatureCache(detector, descriptor, n_max), has_scores(detector)
    succinctness, calibration, rows = Succinctness(k, n_max), Calibration(), []
    for pair, check in tqdm(pairs, desc=name, unit="pair", delay=2, leave=False):
        features = features_of(pair.image0), features_of(pair.image1)
        verified = verify(pair, *features, check, search)
        points = max(map(len, features))
        n_k = verified.points_needed(k, n_max) if scored else all_or_none(verified.judge, points, k, 0)
        if isinstance(detector, SipsDetector):
            add_to_calibration(calibration, verified, n_max)
        rows.append(_row(verified, n_k, n_max))
        succinctness.update(n_k)
    protocol = {
        "detector": detector.name,
        "descriptor": "own" if descriptor is None else descriptor.name,
        "scores": "order" if scored else NO_SCORES,
        "k": k,
        "n_max": n_max,
        "search": search_used(search, pairs),
        **pairs.protocol,
        "versions": versions(),
    }
    measured = calibration.result() if isinstance(detector, SipsDetector) else None
    return Evaluation(name, protocol, succinctness.result(), measured, rows)


def add_to_calibration(calibration: Calibration, verified: VerifiedPair, n: int) -> None:
    """Adds the ``n`` best points of both images, where the truth is known: predicted probability, and inlier or not."""
    matches, inliers = verified.at(n)
    sides = (
        (verified.features0.keypoints.score[:n], matches.index0, inliers.known0),
        (verified.features1.keypoints.score[:n], matches.index1, inliers.known1),
    )
    for scores, point_of_match, known in sides:
        labels = point_labels(inliers, point_of_match, known)
        calibration.update(torch.from_numpy(scores[labels.known]), torch.from_numpy(labels.inlier[labels.known]))


def search_used(search: Search, pairs: PairSet) -> str:
    """What ``search`` comes to with the checks of these pairs: exact, binary, or both."""
    if search != "auto":
        return search
    return " and ".join(sorted({"exact" if check.independent else "binary" for check in pairs.checks}))


def versions() -> dict[str, str]:
    """Versions of what the numbers depend on."""
    return {
        "sips_lit": importlib.metadata.version("sips_lit"),
        "torch": torch.__version__,
        "opencv": cv2.__version__,
        "numpy": np.__version__,
    }


def _row(verified: VerifiedPair, n_k: int | None, n_max: int) -> PairRow:
    matches, inliers = verified.at(n_max)
    points = len(verified.features0), len(verified.features1)
    return PairRow(verified.pair.name, n_k, *points, len(matches), int(inliers.inlier.sum()))

"""What a benchmark measured of one detector on one pair set, as plain arrays: metrics, tables and pictures start here.

P pairs, R repeats of a verification that is random (1 otherwise), K values of k, B budgets of points. A failure is infinite;
what does not apply (pose errors where the pose is not known) is NaN.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.metrics.calibration import CalibrationResult
from sips_lit.metrics.covariance import CovarianceReliability

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class PairTable:
    """The P pairs of a pair set, the same for all detectors.

    ``name`` of each; ``overlap`` (P,); ``gap`` (P,): how many frames later the other is, NaN where their order means
    nothing; ``pixels`` (P,): median distance of places of both images, NaN where unknown; ``rotation`` (P,) in degrees and
    ``translation`` (P,) in metres between the two true poses, NaN where these are not known.
    """

    name: tuple[str, ...]
    overlap: FloatArray
    gap: FloatArray
    pixels: FloatArray
    rotation: FloatArray
    translation: FloatArray

    def __len__(self) -> int:
        return len(self.name)

    @property
    def sequences(self) -> tuple[str, ...]:
        """The sequence of each pair, with which its name begins: of ``street:10-17`` it is ``street``."""
        return tuple(name.rpartition(":")[0] for name in self.name)


class PoseOutcome(IntEnum):
    """What became of the pose of a pair."""

    FOUND = 0
    UNKNOWN = 1
    """Not estimated: the true pose is not known, or the depth of no point is."""
    FEW_MATCHES = 2
    """Fewer than the four matches with a depth that P3P with RANSAC takes."""
    NO_AGREEMENT = 3
    """RANSAC finds no pose that three matches agree with."""
    FEW_INLIERS = 4
    """A pose with fewer inliers than a pose at a budget needs."""


@dataclass(frozen=True, slots=True)
class AtBudget:
    """What the ``n`` best points of both images gave, for each pair; the record of a single pair has the shapes without P.

    ``matches`` (P,), ``inliers`` and pose errors ``rotation_error`` (degrees) and ``translation_error`` (metres) (P, R),
    ``outcome`` (P, R) of the pose (`PoseOutcome`);
    ``repeatability``, ``matching_score`` and ``spread`` (fraction of the cells of a grid that hold an inlier) (P,).
    """

    n: int
    matches: IntArray
    inliers: IntArray
    rotation_error: FloatArray
    translation_error: FloatArray
    outcome: IntArray
    repeatability: FloatArray
    matching_score: FloatArray
    spread: FloatArray


@dataclass(frozen=True, slots=True)
class MethodResult:
    """One detector with one descriptor on one pair set.

    ``n_k`` (P, R, K): points needed for each k of ``ks``, inf = failure; ``n_k_judged`` (P, R, K): the same of the points
    alone whose truth is known; ``unknown`` (P,): share of the others, NaN without points. ``rotation_error`` and
    ``translation_error`` (P, R, K): of the pose from the matches at n_k. ``points0`` and ``points1`` (P,): points found when
    ``n_max`` were asked for. ``budgets``: by n. ``calibration``: by n, for detectors whose scores are probabilities.
    ``covariance``: by n, for detectors that tell the covariance of places, where residuals are measured.
    ``milliseconds``: mean time of each stage (detect, describe and depth: per image, when its features were made; match,
    verify, metrics: per pair). ``defects``: counts of what was wrong with the detector's output. ``protocol``: how all this
    was obtained.
    """

    key: str
    name: str
    protocol: Mapping[str, Any]
    pairs: PairTable
    ks: tuple[int, ...]
    n_max: int
    n_k: FloatArray
    n_k_judged: FloatArray
    unknown: FloatArray
    rotation_error: FloatArray
    translation_error: FloatArray
    points0: IntArray
    points1: IntArray
    budgets: Mapping[int, AtBudget]
    calibration: Mapping[int, CalibrationResult]
    milliseconds: Mapping[str, float]
    defects: Mapping[str, int]
    covariance: Mapping[int, CovarianceReliability] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class PairSetResult:
    """All detectors on one pair set. ``skipped``: detectors that could not run, with the reason in one sentence."""

    key: str
    title: str
    protocol: Mapping[str, Any]
    detectors: tuple[MethodResult, ...]
    skipped: Mapping[str, str]

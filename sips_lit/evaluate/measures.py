"""What an evaluation measures, and the numbers that define it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from numbers import Integral, Real
from typing import Any, get_args

from sips_lit.errors import BadInputError
from sips_lit.inliers.stereo_p3p import PoseWeights
from sips_lit.inliers.verification import Search
from sips_lit.types import ScoreKind

KS = (5, 6, 7, 8, 10, 12, 15, 20, 25, 30)
"""The paper's."""
_KINDS = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a word",
    tuple: "a list of whole numbers",
}


@dataclass(frozen=True, slots=True)
class Measures:
    """What is measured.

    ``k``: inliers that a pair needs, within ``n_max`` points, and more such numbers, ``ks``, of which those below ``n_max``
    count; ``n``: points at which the rest is measured, and more such numbers, ``budgets``; ``search``: see `verify`;
    ``repeats`` of checks that are random; ``calibration``: budgets for it (probabilities only); ``pose``: whether poses are
    estimated, by RANSAC of ``iterations``, with inliers within ``pose_threshold`` pixels, a pose at a budget counting
    from ``pose_inliers`` on; ``pose_weights``: those of its inliers when it is refined on them (see
    `PreparedStereoP3P.refined`); pose AUC up to ``translation_limit`` (metres) and ``rotation_limit`` (degrees);
    ``threshold`` (pixels) of repeatability; ``cells`` a side of the grid for the spread.
    Raises BadInputError for what can't be measured.
    """

    k: int = 10
    ks: tuple[int, ...] = KS
    n: int = 50
    budgets: tuple[int, ...] = ()
    n_max: int = 200
    search: Search = "auto"
    repeats: int = 5
    calibration: tuple[int, ...] = (50, 500)
    pose: bool = True
    iterations: int = 3000
    pose_threshold: float = 3.0
    pose_inliers: int = 10
    pose_weights: PoseWeights = "none"
    translation_limit: float = 1.0
    rotation_limit: float = 1.0
    threshold: float = 3.0
    cells: int = 8
    seed: int = 0

    def __post_init__(self) -> None:
        for field in fields(self):
            value, default = getattr(self, field.name), field.default
            if not _alike(value, default):
                raise BadInputError(f"{field.name} is {value}: give {_KINDS[type(default)]}")
        if not 1 <= self.k < self.n_max:
            raise BadInputError(
                f"k is {self.k} and n_max is {self.n_max}: ask for at least one inlier, within more points than that"
            )
        if not all(k >= 1 for k in self.ks) or len(set(self.ks)) < len(self.ks):
            raise BadInputError(f"ks is {list(self.ks)}: give different numbers of inliers, from 1")
        for name, given, points in (("n", self.n, [self.n]), ("budgets", list(self.budgets), self.budgets)):
            if not all(1 <= n <= self.n_max for n in points) or len(set(points)) < len(points):
                raise BadInputError(f"{name} is {given}: give points per image, from 1 to n_max = {self.n_max}")
        if not all(n >= 1 for n in self.calibration):
            raise BadInputError(f"calibration is {list(self.calibration)}: give numbers of points from 1")
        if self.search not in get_args(Search):
            raise BadInputError(f"search is {self.search}: give {', '.join(get_args(Search))}")
        if self.pose_weights not in get_args(PoseWeights):
            raise BadInputError(f"pose_weights is {self.pose_weights}: give {', '.join(get_args(PoseWeights))}")
        for name in ("repeats", "iterations", "cells"):
            if getattr(self, name) < 1:
                raise BadInputError(f"{name} is {getattr(self, name)}: give at least 1")
        for name in ("translation_limit", "rotation_limit"):
            if not 0 < getattr(self, name) < math.inf:
                raise BadInputError(f"{name} is {getattr(self, name)}: give a number above 0")

    @property
    def every_k(self) -> tuple[int, ...]:
        """``k`` and those of ``ks`` that are possible, ascending."""
        return tuple(sorted({self.k, *(k for k in self.ks if k < self.n_max)}))

    @property
    def every_n(self) -> tuple[int, ...]:
        """``n`` and ``budgets``, ascending."""
        return tuple(sorted({self.n, *self.budgets}))

    @property
    def protocol(self) -> dict[str, Any]:
        """All of it as plain values."""
        plain = {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}
        return plain | {"ks": list(self.every_k), "budgets": list(self.every_n)}

    def points(self, scores: ScoreKind) -> int:
        """How many points are extracted per image.

        The best n of probabilities are the first n of more; other detectors, as ORB, choose others among more.
        """
        return max(self.n_max, *self.calibration, 0) if scores == "probability" else self.n_max


def _alike(value: Any, default: Any) -> bool:
    """Whether a value is of the kind of a default: a list of whole numbers, say."""
    if isinstance(default, tuple):
        return isinstance(value, tuple | list) and all(_alike(one, 0) for one in value)
    kinds: dict[type, Any] = {bool: bool, int: Integral, float: Real, str: str}
    return isinstance(value, kinds[type(default)]) and isinstance(value, bool) == isinstance(default, bool)

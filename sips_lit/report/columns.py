"""The columns of the table: titles, definitions and values in one place, for the page, the CSV and the glossary."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from sips_lit.report.summary import Summary

OWN_N: Final = "own n only"
"""Tag of detectors whose points have no order."""


@dataclass(frozen=True, slots=True)
class Column:
    """``key`` heads it in CSV, ``title`` on the page; ``definition`` is a sentence of the glossary.

    ``better`` is 1 where more is better, -1 where less is, 0 where it is neither.
    """

    key: str
    title: str
    definition: str
    digits: int
    better: int
    value: Callable[[Summary], float]
    deviation: Callable[[Summary], float] | None = None


def columns_of(rows: Sequence[Summary]) -> list[Column]:
    """The columns of a pair set's table; those without any value are left out."""
    if not rows:
        return []
    first = rows[0]
    stages = dict.fromkeys(stage for row in rows for stage in row.milliseconds)
    budgets = sorted({n for row in rows for n in row.ece})
    columns = [*_succinctness(first.k, first.n_max), *_at_budget(first.n, *first.limits), *map(_ece, budgets)]
    columns += [_points(first.n_max), *map(_stage, stages)]
    return [column for column in columns if not all(math.isnan(column.value(row)) for row in rows)]


def text_of(value: float, digits: int) -> str:
    """A value as people read it: ``never`` for what is infinite, a dash for what is undefined."""
    if math.isnan(value):
        return "-"
    return "never" if math.isinf(value) else f"{value:.{digits}f}"


def _succinctness(k: int, n_max: int) -> list[Column]:
    return [
        Column(
            "n_at_80",
            "n at 80 %",
            f"The fewest points an image with which 80 % of the pairs have {k} inliers.",
            0,
            -1,
            lambda s: s.n_at_80,
        ),
        Column(
            "median_n",
            "median n",
            f"The fewest points an image with which half of the pairs have {k} inliers.",
            0,
            -1,
            lambda s: s.median,
        ),
        Column(
            "mean_n",
            f"mean n to {k} inliers",
            f"Mean of n_{k} over the pairs that get {k} inliers; read it together with the failures, which it leaves out.",
            1,
            -1,
            lambda s: s.mean_needed,
        ),
        Column(
            "auc",
            f"AUC-{n_max}",
            f"Area under the succinctness curve up to {n_max} points, divided by {n_max}: "
            f"1 - {k} / {n_max} = {1 - k / n_max:.3f} at best, 0 when every pair fails. "
            "± is the standard deviation over the repeats of a random verification.",
            3,
            1,
            lambda s: s.auc,
            lambda s: s.auc_deviation,
        ),
        Column(
            "failures",
            "failures",
            f"Pairs without {k} inliers at any n up to {n_max}; the mean over the repeats.",
            1,
            -1,
            lambda s: s.failures,
        ),
    ]


def _at_budget(n: int | None, metres: float, degrees: float) -> list[Column]:
    if n is None:
        return []
    failed = "A pair without a pose counts as an infinite error; pairs whose true pose is not known are left out."
    return [
        Column(
            f"pose_auc_{metres:g}m",
            f"pose AUC-{metres:g} m at {n}",
            "Area under the curve of translation errors (Euclidean distance, metres) from 0 to "
            f"{metres:g} m, divided by {metres:g} m: 1 is perfect. {failed}",
            3,
            1,
            lambda s: s.translation,
            lambda s: s.translation_deviation,
        ),
        Column(
            f"pose_auc_{degrees:g}deg",
            f"pose AUC-{degrees:g}° at {n}",
            f"The same of rotation errors (geodesic angle) from 0 to {degrees:g} degree{'' if degrees == 1 else 's'}.",
            3,
            1,
            lambda s: s.rotation,
            lambda s: s.rotation_deviation,
        ),
        Column(
            "no_pose",
            f"no pose at {n}",
            f"Pairs without a pose from the {n} best points, though the true one is known; the mean over the repeats. "
            "Why is counted in a table below.",
            1,
            -1,
            lambda s: s.no_pose,
        ),
        Column(
            "repeatability",
            f"repeatability at {n}",
            f"Of the {n} best points of the image that has fewer in the common view, the fraction found again in the other "
            "image. NaN where the true position in the other image is not known.",
            3,
            1,
            lambda s: s.repeatability,
        ),
        Column(
            "matching_score",
            f"matching score at {n}",
            f"Of the {n} best points in the common view, the fraction that is matched rightly by descriptor.",
            3,
            1,
            lambda s: s.matching_score,
        ),
        Column(
            "spread",
            f"spread at {n}",
            "Fraction of the cells of a grid over the image that hold an inlier: more is better for the pose.",
            3,
            1,
            lambda s: s.spread,
        ),
    ]


def _ece(n: int) -> Column:
    return Column(
        f"ece_{n}",
        f"ECE at {n}",
        f"Expected calibration error: mean distance, over the {n} best points, between predicted probability and "
        "frequency of inliers in 20 bins. Only for detectors whose scores are probabilities.",
        3,
        -1,
        lambda s: s.ece.get(n, math.nan),
    )


def _points(n_max: int) -> Column:
    definition = f"Mean number of points that the detector found in an image when asked for {n_max} or more."
    return Column("points", "points found", definition, 1, 0, lambda s: s.points)


def _stage(stage: str) -> Column:
    definition = f"Mean wall-clock time of {stage} (detect and describe: of an image; all others: of a pair)."
    return Column(f"{stage}_ms", f"{stage}, ms", definition, 1, -1, lambda s: s.milliseconds.get(stage, math.nan))

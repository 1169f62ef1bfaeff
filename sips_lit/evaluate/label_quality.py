"""Precision and recall of the inliers of one check, KLT say, against those of another, true pose and depth say."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

import numpy as np

from sips_lit.evaluate.features import extract
from sips_lit.match.mutual_nearest import distances, mutual_nearest
from sips_lit.types import Descriptor, Detector, FramePair, InlierCheck, Inliers, Reason


@dataclass(frozen=True, slots=True)
class LabelQuality:
    """Counts of the matches that two checks both verify; the second one is taken as the truth.

    ``unknown`` matches have no answer of one of the two and count for nothing. The sum of two is that of all their matches.
    """

    true_positives: int = 0
    false_positives: int = 0
    false_negatives: int = 0
    true_negatives: int = 0
    unknown: int = 0

    def __add__(self, other: LabelQuality) -> LabelQuality:
        return LabelQuality(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    @property
    def compared(self) -> int:
        """Matches that both verify."""
        return self.true_positives + self.false_positives + self.false_negatives + self.true_negatives

    @property
    def precision(self) -> float:
        """Fraction of the first one's inliers that are the second one's; NaN without any."""
        positives = self.true_positives + self.false_positives
        return self.true_positives / positives if positives else float("nan")

    @property
    def recall(self) -> float:
        """Fraction of the second one's inliers that are the first one's; NaN without any."""
        inliers = self.true_positives + self.false_negatives
        return self.true_positives / inliers if inliers else float("nan")


def label_quality(answer: Inliers, truth: Inliers) -> LabelQuality:
    """Of the same M matches, verified twice."""
    compared = (answer.reason != Reason.UNKNOWN) & (truth.reason != Reason.UNKNOWN)
    first, second = answer.inlier[compared], truth.inlier[compared]
    return LabelQuality(
        true_positives=int(np.sum(first & second)),
        false_positives=int(np.sum(first & ~second)),
        false_negatives=int(np.sum(~first & second)),
        true_negatives=int(np.sum(~first & ~second)),
        unknown=int(np.sum(~compared)),
    )


def pair_label_quality(
    pair: FramePair, detector: Detector, descriptor: Descriptor | None, check: InlierCheck, truth: InlierCheck, n: int
) -> LabelQuality:
    """Of the matches between the ``n`` best points of both images of a pair; raises as the checks do."""
    features0, features1 = (extract(detector, descriptor, image, n).features for image in (pair.image0, pair.image1))
    matches = mutual_nearest(distances(features0, features1))
    args = pair, features0.keypoints, features1.keypoints, matches
    return label_quality(check(*args), truth(*args))


def by_gap(
    gaps: Iterable[int], qualities: Iterable[LabelQuality], borders: Sequence[int]
) -> list[tuple[str, int, LabelQuality]]:
    """Name, number of pairs and sum for each range of gaps (frames from one image to the other).

    Ranges begin at each of the ``borders``, ascending from 1; the last has no end.
    """
    sums = [LabelQuality() for _ in borders]
    pairs = [0] * len(borders)
    for gap, one in zip(gaps, qualities, strict=True):
        at = int(np.searchsorted(borders, gap, side="right")) - 1
        sums[at] += one
        pairs[at] += 1
    ends = [*(border - 1 for border in borders[1:]), None]
    names = [
        str(begin) if begin == end else f"{begin} to {end}" if end is not None else f"{begin} or more"
        for begin, end in zip(borders, ends, strict=True)
    ]
    return list(zip(names, pairs, sums, strict=True))

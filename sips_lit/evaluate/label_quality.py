"""How far one way of judging matches agrees with another: KLT labels, say, with true pose and depth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from sips_lit.evaluate.features import extract
from sips_lit.match.mutual_nearest import distances, mutual_nearest
from sips_lit.types import Descriptor, Detector, FramePair, InlierCheck, Inliers, Reason


@dataclass(frozen=True, slots=True)
class LabelQuality:
    """Matches that two checks both judge: inliers of ``both``, of the first ``only``, ``missed`` by it, of ``neither``.

    ``unknown`` matches have no answer of one of the two and count for nothing. Agreements add.
    """

    both: int = 0
    only: int = 0
    missed: int = 0
    neither: int = 0
    unknown: int = 0

    def __add__(self, other: LabelQuality) -> LabelQuality:
        return LabelQuality(
            self.both + other.both,
            self.only + other.only,
            self.missed + other.missed,
            self.neither + other.neither,
            self.unknown + other.unknown,
        )

    @property
    def judged(self) -> int:
        """Matches that both judge."""
        return self.both + self.only + self.missed + self.neither

    @property
    def precision(self) -> float:
        """Fraction of the first one's inliers that are the second one's; NaN without any."""
        return self.both / (self.both + self.only) if self.both + self.only else float("nan")

    @property
    def recall(self) -> float:
        """Fraction of the second one's inliers that are the first one's; NaN without any."""
        return self.both / (self.both + self.missed) if self.both + self.missed else float("nan")


def agreement(answer: Inliers, truth: Inliers) -> LabelQuality:
    """Of the same M matches, judged twice."""
    judged = (answer.reason != Reason.UNKNOWN) & (truth.reason != Reason.UNKNOWN)
    first, second = answer.inlier[judged], truth.inlier[judged]
    return LabelQuality(
        both=int(np.sum(first & second)),
        only=int(np.sum(first & ~second)),
        missed=int(np.sum(~first & second)),
        neither=int(np.sum(~first & ~second)),
        unknown=int(np.sum(~judged)),
    )


def pair_label_quality(
    pair: FramePair, detector: Detector, descriptor: Descriptor | None, check: InlierCheck, truth: InlierCheck, n: int
) -> LabelQuality:
    """Of the matches between the ``n`` best points of both images of a pair; raises as the checks do."""
    features0, features1 = (extract(detector, descriptor, image, n) for image in (pair.image0, pair.image1))
    matches = mutual_nearest(distances(features0, features1))
    args = pair, features0.keypoints, features1.keypoints, matches
    return agreement(check(*args), truth(*args))


def by_gap(
    gaps: Iterable[int], agreements: Iterable[LabelQuality], borders: Sequence[int]
) -> list[tuple[str, int, LabelQuality]]:
    """Name, number of pairs and sum for each range of gaps (frames from one image to the other).

    Ranges begin at each of the ``borders``, ascending from 1; the last has no end.
    """
    sums = [LabelQuality() for _ in borders]
    pairs = [0] * len(borders)
    for gap, one in zip(gaps, agreements, strict=True):
        at = int(np.searchsorted(borders, gap, side="right")) - 1
        sums[at] += one
        pairs[at] += 1
    ends = [*(border - 1 for border in borders[1:]), None]
    names = [
        str(begin) if begin == end else f"{begin} to {end}" if end is not None else f"{begin} or more"
        for begin, end in zip(borders, ends, strict=True)
    ]
    return list(zip(names, pairs, sums, strict=True))

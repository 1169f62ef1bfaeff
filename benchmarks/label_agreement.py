"""How far KLT labels agree with geometry, by the length of the gap.

The geometry is depth (stereo where there are no depth maps), moved by the true pose or by the one that P3P with RANSAC
estimates. Where the two differ much, the true poses are not accurate to the 3 px of the labels.

    python benchmarks/label_agreement.py DATA PATH [PAIRS]        DATA: kitti, rgbd, euroc, posed_depth

Precision: fraction of the KLT inliers that are true. Recall: fraction of the true inliers that KLT finds. Only matches whose
depth is known count.
"""

from __future__ import annotations

import importlib
import itertools
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

import cv2
import numpy as np
from tabulate import tabulate

from sips_lit.baselines.fast import Fast
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.describe.sift import RootSift
from sips_lit.evaluate.features import extract
from sips_lit.inliers.klt import KltInliers
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.inliers.stereo_p3p import StereoP3PInliers
from sips_lit.matching.mutual_nearest import distances, mutual_nearest
from sips_lit.pairs.build import build_indexes
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.pairs.sampler import PairSampler, read_pair
from sips_lit.types import Descriptor, Detector, FramePair, InlierCheck, Inliers, Reason

POINTS, BORDERS = 500, [1, 2, 4, 8, 16, 32]
HEADERS = [
    "overlap",
    "truth",
    "points",
    "gap",
    "pairs",
    "matches",
    "depth known",
    "truly inliers",
    "precision",
    "recall",
]


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


def row(overlap: float, truth: str, points: str, gap: str, pairs: int, found: LabelQuality) -> list[object]:
    matches, true = found.compared + found.unknown, found.true_positives + found.false_negatives
    known, share = found.compared / max(matches, 1), true / max(found.compared, 1)
    return [overlap, truth, points, gap, pairs, matches, known, share, found.precision, found.recall]


def main() -> None:
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    data, path, count = sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) == 4 else 40
    sequences = getattr(importlib.import_module(f"sips_lit.datasets.{data}"), data)(path)
    with tempfile.TemporaryDirectory() as folder:
        indexes = build_indexes(sequences, folder, OverlapParameters(), 2)
    check, descriptor = KltInliers(), RootSift()
    truths: dict[str, InlierCheck] = {"true pose": PoseDepthInliers(), "P3P": StereoP3PInliers()}
    rows = []
    for overlap in (0.3, 0.5):
        sampler = PairSampler(indexes, overlap, 0)
        choices = list(dict.fromkeys(sampler.draw(0, i) for i in range(5 * count)))[:count]
        pairs = [read_pair(sequences[choice.sequence], choice.index0, choice.index1) for choice in choices]
        gaps = [abs(choice.index1 - choice.index0) for choice in choices]
        for (name, truth), detector in itertools.product(truths.items(), (ShiTomasi(), Fast())):
            found = [pair_label_quality(pair, detector, descriptor, check, truth, POINTS) for pair in pairs]
            rows.append(row(overlap, name, detector.name, "all", len(pairs), sum(found, LabelQuality())))
            rows += [row(overlap, name, detector.name, *part) for part in by_gap(gaps, found, BORDERS) if part[1]]
    print(f"{data}, {POINTS} points per image, RootSIFT, pairs drawn as in training, OpenCV {cv2.__version__}\n")
    print(tabulate(rows, headers=HEADERS, tablefmt="github", floatfmt=".3f"))


if __name__ == "__main__":
    main()

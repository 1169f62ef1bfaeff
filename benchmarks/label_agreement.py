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

import cv2
from tabulate import tabulate

from sips_lit.baselines.fast import Fast
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.describe.sift import RootSift
from sips_lit.evaluate.label_quality import LabelQuality, by_gap, pair_label_quality
from sips_lit.inliers.klt import KltInliers
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.inliers.stereo_p3p import StereoP3PInliers
from sips_lit.pairs.build import build_indexes
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.pairs.sampler import PairSampler, read_pair
from sips_lit.types import InlierCheck

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

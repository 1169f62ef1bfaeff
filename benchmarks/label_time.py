"""Milliseconds of a label by `inliers=klt_retraced` against `inliers=klt`, and how far the labels agree.

    python benchmarks/label_time.py DATA=PATH ... [--pairs 40] [--cache outputs/frames]      DATA: video, kitti, rgbd, ...

Pairs are drawn as in training; both checks judge the same 500 points of `sips-tiny` and the same matches, in turns, and
times are those of one thread. *Before* tracks every match forth through all frames and, where it ends near, back again, and
searches each step back over the whole pyramid. *Labels* agree over all selected points, *matches* over the matched ones.
Wanted: half the milliseconds over all data, and 0.995 of the labels of each data set.
"""

from __future__ import annotations

import argparse
import importlib
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from tabulate import tabulate

from sips_lit.describe.sift import RootSift
from sips_lit.detect.detector import SipsDetector
from sips_lit.frames.video import video
from sips_lit.inliers.klt import KltInliers
from sips_lit.inliers.klt_retraced import RetracedKltInliers
from sips_lit.pairs.build import build_indexes
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.pairs.sampler import PairSampler, read_pair
from sips_lit.train.labelling import label_pair
from sips_lit.train.step_times import Stopwatch
from sips_lit.types import FramePair, ImageSequence, Keypoints, Reason

POINTS, OVERLAP = 500, 0.1
TIMES, AGREEMENT = 2.0, 0.995
HEADERS = ["data", "pairs", "frames", "describe", "match", "track before", "track", "label before", "label", "times"]


@dataclass(slots=True)
class Compared:
    """Sums over the pairs of a data set; ``different``: labels that are. Only matched points can differ."""

    before: Stopwatch
    now: Stopwatch
    pairs: int = 0
    frames: int = 0
    points: int = 0
    matches: int = 0
    different: int = 0
    inliers_before: int = 0
    inliers: int = 0

    def add(self, pair: FramePair, keypoints0: Keypoints, keypoints1: Keypoints) -> None:
        """Labels a pair both ways."""
        answers = []
        for check, watch in ((KltInliers(), self.before), (RetracedKltInliers(), self.now)):
            answers.append(label_pair(pair, keypoints0, keypoints1, RootSift(), check, watch=watch)[:2])
        self.pairs, self.frames = self.pairs + 1, self.frames + len(pair.frames)
        for before, now in zip(*answers, strict=True):
            self.points += len(now.inlier)
            self.matches += int((now.reason != Reason.UNMATCHED).sum())
            self.different += int((before.inlier != now.inlier).sum())
            self.inliers_before += int(before.inlier.sum())
            self.inliers += int(now.inlier.sum())

    @property
    def agreement(self) -> float:
        """Share of all selected points that have the same label."""
        return 1 - self.different / max(self.points, 1)

    def milliseconds(self) -> tuple[dict[str, float], dict[str, float]]:
        """Of a pair, by stage, before and now."""
        before, now = (
            {stage: 1000 * s / self.pairs for stage, s in watch.seconds.items()} for watch in (self.before, self.now)
        )
        return before, now


def sequences_of(data: str, path: str, cache: str) -> Sequence[ImageSequence]:
    if data == "video":
        return video(path, cache)
    sequences: Sequence[ImageSequence] = getattr(importlib.import_module(f"sips_lit.datasets.{data}"), data)(path)
    return sequences


def compare(sequences: Sequence[ImageSequence], detector: SipsDetector, count: int, indexes: str) -> Compared:
    sampler = PairSampler(build_indexes(sequences, indexes, OverlapParameters(), 1), OVERLAP, 0)
    choices = list(dict.fromkeys(sampler.draw(0, i) for i in range(5 * count)))[:count]
    found = Compared(Stopwatch(time.thread_time), Stopwatch(time.thread_time))
    for choice in choices:
        pair = read_pair(sequences[choice.sequence], choice.index0, choice.index1)
        found.add(pair, detector(pair.image0, n=POINTS), detector(pair.image1, n=POINTS))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", nargs="+", metavar="DATA=PATH")
    parser.add_argument("--pairs", type=int, default=40, help="of each data set")
    parser.add_argument("--cache", help="folder for frames and overlap indexes; default: a temporary one")
    arguments = parser.parse_args()
    cv2.setNumThreads(0)
    torch.set_num_threads(1)
    detector, rows, agreements, totals = SipsDetector.from_pretrained("sips-tiny"), [], [], np.zeros(2)
    with tempfile.TemporaryDirectory() as temporary:
        cache = arguments.cache or temporary
        for given in arguments.data:
            data, path = given.split("=", 1)
            found = compare(sequences_of(data, path, cache), detector, arguments.pairs, cache)
            before, now = found.milliseconds()
            whole = np.array([sum(before.values()), sum(now.values())])
            stages = now["describe"], now["match"], before["track"], now["track"]
            rows.append([given, found.pairs, found.frames / found.pairs, *stages, *whole, whole[0] / whole[1]])
            matched = 1 - found.different / max(found.matches, 1)
            shares = found.inliers_before / found.points, found.inliers / found.points
            agreements.append([given, found.agreement, matched, *shares])
            totals += whole
    print(
        f"{POINTS} points an image, RootSIFT, overlap >= {OVERLAP}, OpenCV {cv2.__version__}; milliseconds of a pair\n"
    )
    print(tabulate(rows, headers=HEADERS, tablefmt="github", floatfmt=".1f"), end="\n\n")
    names = ["data", "labels that agree", "matches that agree", "inliers before", "inliers"]
    print(tabulate(agreements, headers=names, tablefmt="github", floatfmt=".4f"), end="\n\n")
    least = min(row[1] for row in agreements)
    print(f"over all data a label takes {totals[0] / totals[1]:.2f} times fewer milliseconds (wanted: {TIMES:g})")
    print(f"least agreement of labels: {least:.4f} (wanted: {AGREEMENT:g})")


if __name__ == "__main__":
    main()

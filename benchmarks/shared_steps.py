"""What pairs of one training step could share of tracking, and what that would save.

    python benchmarks/shared_steps.py DATA=PATH ... [--cache outputs/frames]      DATA: video, kitti, rgbd, ...

Pairs are drawn as in training. A *step* is one from a frame to the next: a pair of frames 3 and 7 is tracked through four
of them. *Saved* is the share of the steps of 2 or 8 pairs that would not be searched if each were searched once for all
pairs that pass it. Their points differ, so what can be shared is the image pyramids: milliseconds of a search by OpenCV for
some numbers of points, of one thread, and of its two pyramids.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterable

import cv2
import numpy as np
from label_time import OVERLAP, sequences_of
from tabulate import tabulate

from sips_lit.pairs.build import build_indexes
from sips_lit.pairs.overlap import OverlapParameters
from sips_lit.pairs.sampler import PairChoice, PairSampler
from sips_lit.tracking.klt import KltTracker
from sips_lit.types import GreyImage

TRAINING_STEPS = 200
"""of a training, that the shares are means of"""
PAIRS = 2, 8
POINTS = 70, 250, 500
ROUNDS = 30


def saved(choices: Iterable[PairChoice]) -> float:
    """Share of the steps of some pairs that another of them has, too, each counted but once."""
    steps = [
        (each.sequence, frame)
        for each in choices
        for frame in range(min(each.index0, each.index1), max(each.index0, each.index1))
    ]
    return 1 - len(set(steps)) / len(steps)


def mean_saved(sampler: PairSampler, pairs: int) -> float:
    """Over the first steps of a training that takes some pairs a step."""
    drawn = [[sampler.draw(0, pairs * step + i) for i in range(pairs)] for step in range(TRAINING_STEPS)]
    return float(np.mean([saved(choices) for choices in drawn]))


def least_milliseconds(function: Callable[[], object]) -> float:
    seconds = []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        function()
        seconds.append(time.perf_counter() - begin)
    return 1000 * min(seconds)


def search_times(image0: GreyImage, image1: GreyImage) -> list[list[float]]:
    """A row for each number of points: found corners, milliseconds of the search, of both pyramids alone."""
    klt = KltTracker()
    window = klt.window, klt.window
    rows = []
    for count in POINTS:
        corners = cv2.goodFeaturesToTrack(image0, count, 1e-4, 3)
        search = least_milliseconds(
            lambda corners=corners: cv2.calcOpticalFlowPyrLK(
                image0, image1, corners, None, winSize=window, maxLevel=klt.max_level
            )
        )
        pyramids = least_milliseconds(
            lambda: [cv2.buildOpticalFlowPyramid(image, window, klt.max_level) for image in (image0, image1)]
        )
        rows.append([len(corners), search, pyramids])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", nargs="+", metavar="DATA=PATH")
    parser.add_argument("--cache", help="folder for frames and overlap indexes; default: a temporary one")
    arguments = parser.parse_args()
    cv2.setNumThreads(0)
    shares = []
    with tempfile.TemporaryDirectory() as temporary:
        cache = arguments.cache or temporary
        for given in arguments.data:
            data, path = given.split("=", 1)
            sequences = sequences_of(data, path, cache)
            sampler = PairSampler(build_indexes(sequences, cache, OverlapParameters(), 1), OVERLAP, 0)
            frames = sum(len(sequence) for sequence in sequences)
            shares.append([given, frames, *(mean_saved(sampler, pairs) for pairs in PAIRS)])
            images = sequences[0].frame(0), sequences[0].frame(1)
    head = ["data", "frames", *(f"saved of {pairs} pairs" for pairs in PAIRS)]
    print(tabulate(shares, head, tablefmt="github", floatfmt=".3f"), end="\n\n")
    print(f"{given}, {images[0].shape[1]}x{images[0].shape[0]}, least of {ROUNDS} rounds\n")
    print(
        tabulate(
            search_times(*images), ["points", "search, ms", "both pyramids, ms"], tablefmt="github", floatfmt=".2f"
        )
    )


if __name__ == "__main__":
    main()

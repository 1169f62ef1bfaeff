"""Where the best points of detectors get lost between two frames: not followed, not found again, not matched.

    python benchmarks/lost_points.py PATH [CHECKPOINT ...] [--gap 3] [--every 4] [--points 20 40 80]

PATH is a folder of images or a video. Pairs are GAP frames apart and begin at every EVERY-th frame. KLT follows the n best
points of the first image through the frames between. A row says which share of them it *follows* to the end; for which it
ends within 3 pixels of one of the 200 best points of the last image (*seen*); of one of its n best (*found*); and of the
point that upright RootSIFT matches with it, mutually among the n best (*inliers*). Checkpoints stand beside Harris and
Shi-Tomasi.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tabulate import tabulate

from sips_lit.baselines.harris import Harris
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.describe.sift import RootSift
from sips_lit.detect.base import BaseDetector
from sips_lit.detect.detector import SipsDetector
from sips_lit.frames.folder import folder
from sips_lit.frames.video import video
from sips_lit.matching.mutual_nearest import distances, mutual_nearest
from sips_lit.tracking.klt import KltTracker
from sips_lit.types import Descriptor, Features, GreyImage, ImageSequence, Keypoints

NEAR = 3.0  # pixels
MANY = 200  # points

HEADERS = ["detector", "n", "followed", "seen", "found", "inliers"]


def fates(
    ends: NDArray[np.float32],
    followed: NDArray[np.bool_],
    later: NDArray[np.float32],
    n: int,
    partners: NDArray[np.int64],
) -> tuple[float, float, float, float]:
    """Shares of the n best points that are followed, seen, found and inliers.

    ``ends`` (N, 2) and ``followed`` (N,) of the points of the first image, best first; ``later`` (M, 2) points of the last,
    best first; ``partners`` (n,): which of these each of the n best is matched with, -1 for none.
    """
    apart = np.linalg.norm(ends[:n, None] - later[None], axis=2)
    near = (apart <= NEAR) & followed[:n, None]
    matched = np.flatnonzero(partners >= 0)
    inliers = near[matched, partners[matched]].sum() / len(near)
    return float(followed[:n].mean()), float(near.any(1).mean()), float(near[:, :n].any(1).mean()), float(inliers)


def partners_of(
    images: tuple[GreyImage, GreyImage], points: tuple[Keypoints, Keypoints], descriptor: Descriptor
) -> NDArray[np.int64]:
    """For each point of the first image its mutual nearest neighbour in the other, -1 for none."""
    features = [
        Features(keypoints, descriptor.describe(image, keypoints), descriptor.norm)
        for image, keypoints in zip(images, points, strict=True)
    ]
    matches = mutual_nearest(distances(*features))
    partners = np.full(len(points[0]), -1)
    partners[matches.index0] = matches.index1
    return partners


def rows_of(
    name: str, detector: BaseDetector, sequence: ImageSequence, gap: int, every: int, points: Sequence[int]
) -> list[list[object]]:
    """A row of the table for each number of points: the mean over the pairs."""
    tracker, descriptor = KltTracker(), RootSift()
    shares: dict[int, list[tuple[float, float, float, float]]] = {n: [] for n in points}
    for first in range(0, len(sequence) - gap, every):
        frames = tuple(sequence.frame(index) for index in range(first, first + gap + 1))
        before, later = (detector.detect(image, MANY) for image in (frames[0], frames[-1]))
        ends, followed = tracker.track(frames, before.xy)
        for n in points:
            best = before.best(n), later.best(n)
            partners = partners_of((frames[0], frames[-1]), best, descriptor)
            shares[n].append(fates(ends, followed, later.xy, n, partners))
    return [[name, n, *np.mean(shares[n], axis=0)] for n in points]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("path", type=Path)
    parser.add_argument("checkpoints", type=Path, nargs="*")
    parser.add_argument("--gap", type=int, default=3)
    parser.add_argument("--every", type=int, default=4)
    parser.add_argument("--points", type=int, nargs="+", default=[20, 40, 80])
    given = parser.parse_args()
    detectors: dict[str, BaseDetector] = {"Harris": Harris(), "Shi-Tomasi": ShiTomasi()}
    detectors |= {str(path): SipsDetector.from_checkpoint(path) for path in given.checkpoints}
    with tempfile.TemporaryDirectory() as cache:
        sequences = folder(given.path) if given.path.is_dir() else video(given.path, cache)
        rows = []
        for name, detector in detectors.items():
            rows += rows_of(name, detector, sequences[0], given.gap, given.every, given.points)
    print(tabulate(rows, HEADERS, floatfmt=".2f"))


if __name__ == "__main__":
    main()

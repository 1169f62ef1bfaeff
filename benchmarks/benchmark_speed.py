"""Succinctness by true poses of many pairs, with cached features, against matching and verifying anew at every n.

python benchmarks/benchmark_speed.py [KITTI] [--p3p]: with a KITTI odometry folder real stereo pairs, without one a made-up
wall. ``--p3p`` times the search with P3P in RANSAC as well (100 pairs, 5 repeats, k = 10).
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.datasets.kitti import kitti
from sips_lit.describe.sift import RootSift
from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.method import Method
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.evaluate.runner import evaluate_pair_set, extract_all
from sips_lit.frames.source import Source
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.inliers.stereo_p3p import StereoP3PInliers
from sips_lit.matching.mutual_nearest import distances, mutual_nearest
from sips_lit.pairs.choice import ListedPair, choose_pairs
from sips_lit.types import Camera, FloatArray, GreyImage, ImageSequence

WIDTH, HEIGHT, STEP, K, N_MAX, SLOW_PAIRS = 1241, 376, 6, 10, 200, 10


class Wall(ImageSequence):
    """A stereo camera that moves along a textured wall, 10 m away: a metre is 70 pixels."""

    name, fingerprint = "wall", "wall"

    def __init__(self) -> None:
        noise = np.random.default_rng(0).standard_normal((HEIGHT, WIDTH + 60 * STEP))
        layers = sum(cv2.GaussianBlur(noise, (0, 0), sigma) * sigma for sigma in (1.5, 3, 6))
        self.wall = np.clip(127 + 60 * layers, 0, 255).astype(np.uint8)

    def __len__(self) -> int:
        return 51

    def frame(self, index: int) -> GreyImage:
        return np.ascontiguousarray(self.wall[:, STEP * index :][:, :WIDTH])

    def right(self, index: int) -> GreyImage:
        return np.ascontiguousarray(self.wall[:, STEP * index + 35 :][:, :WIDTH])

    def baseline(self) -> float:
        return 0.5

    def camera(self, index: int) -> Camera:
        return Camera(np.array([[700.0, 0, WIDTH / 2], [0, 700, HEIGHT / 2], [0, 0, 1]]), (WIDTH, HEIGHT))

    def pose(self, index: int) -> FloatArray:
        pose = np.eye(4)
        pose[0, 3] = STEP * index / 70
        return pose


def anew_at_every_n(pairs: PairSet, cache: Path, method: Method) -> tuple[list[float], float]:
    """n_k of the first pairs by cropping, matching and verifying for each n, and the time of that without features."""
    features = extract_all(method, pairs, cache, N_MAX, "features")
    check, needed, start = PoseDepthInliers(), [], time.perf_counter()
    for at, listed in enumerate(pairs.listed[:SLOW_PAIRS]):
        first, second = (features[listed.sequence, index].features for index in (listed.index0, listed.index1))
        prepared = check.prepare(pairs.read(at, depth=True), first.keypoints, second.keypoints)
        counts = [
            int(prepared(mutual_nearest(distances(first.best(n), second.best(n)))).inlier.sum())
            for n in range(N_MAX + 1)
        ]
        needed.append(next((float(n) for n, count in enumerate(counts) if count >= K), np.inf))
    return needed, time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kitti", nargs="?")
    parser.add_argument("--p3p", action="store_true")
    arguments = parser.parse_args()
    method = Method("shi_tomasi", "Shi-Tomasi", ShiTomasi(), RootSift(), {})
    with tempfile.TemporaryDirectory() as folder:
        if arguments.kitti:
            sources = [Source(kitti(arguments.kitti))]
            listed = choose_pairs(sources, Path(folder) / "indexes")
        else:
            sources = [Source([Wall()])]
            starts = np.random.default_rng(0).integers(0, 40, (100, 2)) % [40, 10] + [0, 1]
            listed = [ListedPair(0, int(a), int(a + b), np.nan) for a, b in starts]
        cache = Path(folder) / "features"
        extract_all(method, PairSet(sources, listed, PoseDepthInliers()), cache, N_MAX, "features")
        # a fresh start: only the features are cached
        pairs = PairSet(sources, listed, PoseDepthInliers())
        measures = Measures(n_max=N_MAX, pose=False, budgets=())
        for frames in ("frames read anew", "frames cached"):  # as for the first detector, as for all others
            start = time.perf_counter()
            (result,) = evaluate_pair_set([method], pairs, measures, cache, workers=1).detectors
            fast = time.perf_counter() - start
            print(f"exact succinctness of {len(pairs)} pairs, all k, {frames}: {fast:.1f} s (wanted: under 5 s)")
        needed, slow = anew_at_every_n(pairs, cache, method)
        assert needed == result.n_k[: len(needed), 0, result.ks.index(K)].tolist(), "the two ways disagree"
        each = slow / len(needed)
        ratio = each / (fast / len(pairs))
        print(f"anew at every n: {1e3 * each:.0f} ms per pair, {ratio:.0f} times as long (wanted: 5 times), same n_k")
        if arguments.p3p:
            pairs = PairSet(sources, listed, StereoP3PInliers())
            start = time.perf_counter()
            evaluate_pair_set([method], pairs, Measures(ks=(K,), n_max=N_MAX, pose=False, budgets=()), cache)
            print(
                f"P3P, {len(pairs)} pairs, 5 repeats, k = {K}: {time.perf_counter() - start:.0f} s (wanted: under 180 s)"
            )


if __name__ == "__main__":
    main()

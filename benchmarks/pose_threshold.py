"""Relative poses by `sips-match camera=...` against true ones, for several thresholds of the search.

    python benchmarks/pose_threshold.py DATA PATH [--gaps 1 2 4] [--pairs 25] [--thresholds 0.5 1 1.5 2 3]

DATA: kitti, rgbd, posed_depth, ... with poses and cameras. Rows: detector, points and frames apart; columns: of each
threshold the area under the curve of the turn's errors up to 2 degrees, and of those of the direction of motion up to 20.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Sequence

import numpy as np
from tabulate import tabulate

from sips_lit.baselines.sift import SiftDetector
from sips_lit.detect.detector import SipsDetector
from sips_lit.geometry.pose import PoseEstimate, rotation_error
from sips_lit.geometry.two_view import fit_relative_pose
from sips_lit.inference.match import PairMatcher, View
from sips_lit.metrics.pose_auc import pose_auc
from sips_lit.types import FloatArray, ImageSequence

TURN, DIRECTION = 2.0, 20.0


def direction_error(estimate: FloatArray, truth: FloatArray) -> float:
    """Angle in degrees between the translations of two poses (4, 4); infinite where one has none."""
    (a, b) = (np.asarray(pose)[:3, 3] for pose in (estimate, truth))
    lengths = np.linalg.norm(a) * np.linalg.norm(b)
    return float(np.degrees(np.arccos(np.clip(a @ b / lengths, -1, 1)))) if lengths > 0 else np.inf


def errors(found: PoseEstimate, truth: FloatArray) -> tuple[float, float]:
    """Of the turn and of the direction, in degrees; infinite without a pose."""
    if found.T_1_0 is None:
        return np.inf, np.inf
    return rotation_error(found.T_1_0, truth), direction_error(found.T_1_0, truth)


def row(matcher: PairMatcher, sequence: ImageSequence, gap: int, pairs: int, thresholds: Sequence[float]) -> list[str]:
    """The cells of all thresholds, on up to ``pairs`` pairs spread over the sequence."""
    starts = np.unique(np.linspace(0, len(sequence) - gap - 1, pairs).round().astype(int)).tolist()
    views: dict[int, View] = {}
    found: dict[float, list[tuple[float, float]]] = {threshold: [] for threshold in thresholds}
    for start in starts:
        for index in (start, start + gap):
            if index not in views:
                views[index] = matcher.view(sequence.frame(index))
        pair = matcher.join(views[start], views[start + gap])
        cameras, poses = zip(*((sequence.camera(i), sequence.pose(i)) for i in (start, start + gap)), strict=True)
        if None in cameras or any(pose is None for pose in poses):
            raise SystemExit(f"{sequence.name} has no cameras and poses")
        truth = np.linalg.inv(poses[1]) @ poses[0]
        for threshold in thresholds:
            found[threshold].append(
                errors(fit_relative_pose(pair.xy0, pair.xy1, cameras[0], cameras[1], threshold), truth)
            )
    return [
        ", ".join(
            f"{pose_auc(column, limit):.2f}"
            for column, limit in zip(zip(*both, strict=True), (TURN, DIRECTION), strict=True)
        )
        for both in found.values()
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data")
    parser.add_argument("path")
    parser.add_argument("--gaps", type=int, nargs="+", default=(1, 2, 4))
    parser.add_argument("--pairs", type=int, default=25)
    parser.add_argument("--thresholds", type=float, nargs="+", default=(0.5, 1.0, 1.5, 2.0, 3.0))
    options = parser.parse_args()
    (sequence, *_) = getattr(importlib.import_module(f"sips_lit.datasets.{options.data}"), options.data)(options.path)
    detectors = {"sips-tiny": SipsDetector.from_pretrained("sips-tiny"), "SIFT + RootSIFT": SiftDetector()}
    rows = []
    for name, detector in detectors.items():
        for n in (100, 500):
            matcher = PairMatcher(detector, n=n)
            rows += [
                [name, n, gap, *row(matcher, sequence, gap, options.pairs, options.thresholds)] for gap in options.gaps
            ]
    print(tabulate(rows, ["detector", "points", "frames apart", *(f"{t:g} px" for t in options.thresholds)]))


if __name__ == "__main__":
    main()

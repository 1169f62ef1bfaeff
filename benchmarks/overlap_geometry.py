"""What the overlap of KLT tracks says about the scene: against the share of points that the other image truly sees.

    python benchmarks/overlap_geometry.py DATA PATH [--pairs 300] [--seed 0]      DATA: kitti, rgbd, posed_depth, ...

The overlap is measured twice: of corners, as the package does, and of a point in nearly every cell of the grid (quality 0).
The truth: corners of the earlier frame, as a detector could choose them, are moved to the later one by depth (stereo where
there are no maps) and true pose; visible are those inside the image, in front of the camera and not behind a nearer surface.
Only points whose depth is known count. Distances in frames, of those at which any track
survives, are drawn alike on a logarithmic scale.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from tabulate import tabulate

from sips_lit.geometry.projection import View, frame_view, inside, transfer
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.pairs.overlap import OverlapIndex, OverlapParameters, corners_to_track, measure_overlap
from sips_lit.types import DisparityMatcher, FloatArray, ImageSequence

MEASURES = {"corners": OverlapParameters(), "every cell": OverlapParameters(quality=0)}
NONE = np.zeros((0, 2), np.float32)
OCCLUSION = 0.1  # relative, of depth: stereo is that exact on far surfaces
ENOUGH = 20  # points of known depth, for a share
EDGES = np.arange(11) / 10
HEADERS = ["measure", "overlap", "pairs", "frames apart", "metres", "truly visible", "10 to 90 %", "pixels"]


@dataclass(frozen=True, slots=True)
class MeasuredPair:
    """``overlaps`` and ``pixels`` (median displacement) by measure; ``visible``: the true share."""

    gap: int
    metres: float
    visible: float
    overlaps: tuple[float, ...]
    pixels: tuple[float, ...]


def visible_share(
    here: View, there: View, T_there_here: FloatArray, xy: FloatArray, stereo: DisparityMatcher
) -> tuple[float, int]:
    """The share of N points (N, 2) that the other view sees, of those whose depth is known, and how many these are."""
    depth = here.depth_at(xy, stereo)
    known = np.isfinite(depth)
    if not known.any():
        return float("nan"), 0
    moved, distance = transfer(xy[known], depth[known], here.camera, there.camera, T_there_here)
    seen = inside(moved, there.camera.size)
    surface = there.depth_at(moved[seen], stereo)
    seen[seen] = ~(surface < distance[seen] * (1 - OCCLUSION))  # where the surface is not known nothing hides the point
    return float(seen.mean()), int(known.sum())


def draw_pairs(indexes: Sequence[OverlapIndex], count: int, seed: int) -> list[tuple[int, int]]:
    """Different pairs of frames i < j, at most ``count``, that have tracks in any index; each octave of distance alike."""
    reach = np.max([np.diff(index.offsets) for index in indexes], axis=0)
    pairs = [
        (i, i + gap) for gap in range(1, int(reach.max(initial=0)) + 1) for i in np.flatnonzero(reach >= gap).tolist()
    ]
    if not pairs:
        return []
    gaps = np.array([j - i for i, j in pairs])
    weights = 1 / (np.bincount(gaps)[gaps] * gaps)  # the same for each octave
    generator = np.random.default_rng(seed)
    chosen = generator.choice(len(pairs), min(count, len(pairs)), replace=False, p=weights / weights.sum())
    return [pairs[at] for at in sorted(chosen.tolist())]


def measure_pairs(
    sequence: ImageSequence, count: int, seed: int, stereo: DisparityMatcher | None = None
) -> Iterator[MeasuredPair]:
    """Pairs of a sequence whose poses are known and which has corners of known depth."""
    stereo = stereo or StereoMatcher()
    indexes = [measure_overlap(sequence, parameters) for parameters in MEASURES.values()]
    for i, j in draw_pairs(indexes, count, seed):
        here, there, pose0, pose1 = frame_view(sequence, i), frame_view(sequence, j), sequence.pose(i), sequence.pose(j)
        if here is None or there is None or pose0 is None or pose1 is None:
            continue
        T = np.linalg.inv(pose1) @ pose0
        visible, points = visible_share(here, there, T, corners_to_track(here.image, NONE, OverlapParameters()), stereo)
        if points < ENOUGH:
            continue
        measured = [of_pair(index, i, j) for index in indexes]
        overlaps, pixels = (tuple(column) for column in zip(*measured, strict=True))
        yield MeasuredPair(j - i, float(np.linalg.norm(T[:3, 3])), visible, overlaps, pixels)


def of_pair(index: OverlapIndex, i: int, j: int) -> tuple[float, float]:
    """Overlap and median displacement in pixels; 0 and NaN where no track survives."""
    overlap, motion = index.overlap(i), index.motion_to(i)
    return (float(overlap[j - i - 1]), float(motion[j - i - 1, 0])) if len(overlap) >= j - i else (0.0, float("nan"))


def rank_correlation(a: Sequence[float], b: Sequence[float]) -> float:
    """Spearman's, with the mean rank for ties; NaN where one does not vary."""
    ranks = [mean_ranks(np.asarray(values, np.float64)) for values in (a, b)]
    if min(np.ptp(rank) if len(rank) else 0.0 for rank in ranks) == 0:
        return float("nan")
    return float(np.corrcoef(ranks[0], ranks[1])[0, 1])


def mean_ranks(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rank of each of N values (N,), from 0."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(counts) - (counts + 1) / 2)[place], np.float64)


def rows(pairs: Sequence[MeasuredPair]) -> list[list[object]]:
    """By measure and range of its overlap: medians of the pairs."""
    table: list[list[object]] = []
    for at, name in enumerate(MEASURES):
        overlaps = np.array([pair.overlaps[at] for pair in pairs])
        bins = np.clip(np.searchsorted(EDGES, overlaps, side="right") - 1, 0, len(EDGES) - 2)
        for number in np.unique(bins):
            part = [pair for pair, own in zip(pairs, bins, strict=True) if own == number]
            visible = [pair.visible for pair in part]
            low, high = np.percentile(visible, (10, 90))
            pixels = [pair.pixels[at] for pair in part if pair.pixels[at] == pair.pixels[at]]
            medians = [np.median([getattr(pair, key) for pair in part]) for key in ("gap", "metres", "visible")]
            table.append(
                [name, f"{EDGES[number]:.1f} to {EDGES[number + 1]:.1f}", len(part), f"{medians[0]:.0f}"]
                + [f"{value:.2f}" for value in medians[1:]]
                + [f"{low:.2f} to {high:.2f}", f"{np.median(pixels):.0f}" if pixels else ""]
            )
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", help="which loader")
    parser.add_argument("path", help="the data set's folder")
    parser.add_argument("--pairs", type=int, default=300, help="of each sequence at most")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    sequences = getattr(importlib.import_module(f"sips_lit.datasets.{options.data}"), options.data)(options.path)
    pairs = [pair for sequence in sequences for pair in measure_pairs(sequence, options.pairs, options.seed)]
    if not pairs:
        raise SystemExit(f"{options.path} has no pair of frames whose poses and depth are known")
    print(f"{options.data}, {len(pairs)} pairs, OpenCV {cv2.__version__}\n")
    print(tabulate(rows(pairs), headers=HEADERS, tablefmt="github", disable_numparse=True))
    for at, name in enumerate(MEASURES):
        overlaps, visible = [pair.overlaps[at] for pair in pairs], [pair.visible for pair in pairs]
        difference = np.subtract(overlaps, visible)
        print(
            f"\n{name}: rank correlation with the truth {rank_correlation(overlaps, visible):.3f}; overlap less truth: "
            f"median {np.median(difference):+.2f}, mean of the absolute values {np.abs(difference).mean():.2f}"
        )


if __name__ == "__main__":
    main()

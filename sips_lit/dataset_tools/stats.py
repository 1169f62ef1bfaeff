"""What the motion of a sequence is like: overlap against the gap of frames, how far pixels and camera move, its pairs."""

from __future__ import annotations

import itertools
from collections.abc import Container, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sips_lit.dataset_tools.difficulty import TRAINING, PairSpread, pair_spread
from sips_lit.pairs.overlap import OverlapIndex
from sips_lit.render.figure import LINE_COLOURS, clean, new_figure
from sips_lit.tracking.klt import KltTracker
from sips_lit.types import GreyImage, ImageSequence

GAPS = (1, 2, 5, 10, 20, 50, 100)
SAMPLES = 40  # neighbouring frames whose motion is measured
SHOWN = 12  # sequences that a picture shows


@dataclass(frozen=True, slots=True)
class SequenceStats:
    """Motion and overlap of a sequence of N frames.

    ``overlap`` (G, 3): quartiles of the overlap of frames that are ``GAPS`` apart, NaN where no frames are;
    ``reach_training`` and ``reach_testing`` (N,): later frames with overlap >= `TRAINING` and >= 0.5 of each frame;
    ``pixels`` (S,): median motion of points between neighbours, sampled; ``metres`` and ``degrees`` (N - 1,): motion between
    neighbours by the poses; ``spread``: that of its pairs.
    """

    name: str
    frames: int
    overlap: NDArray[np.float64]
    reach_training: NDArray[np.int64]
    reach_testing: NDArray[np.int64]
    pixels: NDArray[np.float64]
    metres: NDArray[np.float64]
    degrees: NDArray[np.float64]
    spread: PairSpread


def sequence_stats(sequence: ImageSequence, index: OverlapIndex, tracker: KltTracker | None = None) -> SequenceStats:
    """Statistics of a sequence with its overlap index; frames that can't be read are left out."""
    metres, degrees = pose_steps(sequence)
    return SequenceStats(
        sequence.name,
        len(sequence),
        overlap_by_gap(index),
        index.reach(TRAINING),
        index.reach(0.5),
        pixel_steps(sequence, tracker or KltTracker(), index.unreadable),
        metres,
        degrees,
        pair_spread(index, sequence.temporal),
    )


def overlap_by_gap(index: OverlapIndex) -> NDArray[np.float64]:
    """(G, 3): lower quartile, median and upper quartile of the overlap over each of `GAPS`."""
    rows = [index.overlap(i) for i in range(len(index))]
    table = np.full((len(GAPS), 3), np.nan)
    for row, gap in enumerate(GAPS):
        values = [overlap[gap - 1] if len(overlap) >= gap else 0.0 for overlap in rows[: max(0, len(rows) - gap)]]
        if values:
            table[row] = np.percentile(values, [25, 50, 75])
    return table


def pixel_steps(sequence: ImageSequence, tracker: KltTracker, unreadable: Container[int] = ()) -> NDArray[np.float64]:
    """Median motion in pixels of tracked corners between up to `SAMPLES` evenly spaced pairs of neighbours.

    Neighbours of which one is ``unreadable`` are left out.
    """
    starts = [i for i in range(len(sequence) - 1) if i not in unreadable and i + 1 not in unreadable]
    chosen = {starts[i] for i in np.linspace(0, len(starts) - 1, SAMPLES).astype(int)} if starts else set()
    steps = (_median_step(sequence.frame(i), sequence.frame(i + 1), tracker) for i in sorted(chosen))
    return np.array([step for step in steps if step is not None], np.float64)


def _median_step(image0: GreyImage, image1: GreyImage, tracker: KltTracker) -> float | None:
    corners = cv2.goodFeaturesToTrack(image0, 200, 0.01, 8)
    if corners is None or image0.shape != image1.shape:
        return None
    xy = np.asarray(corners, np.float32).reshape(-1, 2)
    ends, holds = tracker.step(image0, image1, xy)
    return float(np.median(np.linalg.norm(ends - xy, axis=1)[holds])) if holds.any() else None


def pose_steps(sequence: ImageSequence) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Metres and degrees between neighbouring frames whose poses are known."""
    poses = [sequence.pose(i) for i in range(len(sequence))]
    moves = [np.linalg.inv(a) @ b for a, b in itertools.pairwise(poses) if a is not None and b is not None]
    if not moves:
        return np.zeros(0), np.zeros(0)
    T = np.array(moves)
    # sine and cosine of the angle: the arc cosine alone is blind near zero
    skew = T[:, [2, 0, 1], [1, 2, 0]] - T[:, [1, 2, 0], [2, 0, 1]]
    angle = np.arctan2(np.linalg.norm(skew, axis=1), np.trace(T[:, :3, :3], axis1=1, axis2=2) - 1)
    return np.linalg.norm(T[:, :3, 3], axis=1), np.degrees(angle)


def draw_stats(stats: Sequence[SequenceStats]) -> Figure:
    """Overlap against the gap, how far partners reach, and motion of neighbours and pairs, of the first sequences."""
    figure = new_figure(14, 3.4)
    overlaps, reaches, motions, pairs = figure.subplots(1, 4)
    shown = stats[:SHOWN]
    for i, s in enumerate(shown):
        colour, style = LINE_COLOURS[i % len(LINE_COLOURS)], "-" if i < len(LINE_COLOURS) else "--"
        overlaps.plot(GAPS, s.overlap[:, 1], style, marker=".", color=colour, label=s.name)
        overlaps.fill_between(GAPS, s.overlap[:, 0], s.overlap[:, 2], color=colour, alpha=0.12, linewidth=0)
        reaches.plot(np.sort(s.reach_training)[::-1], np.linspace(0, 1, s.frames), style, color=colour)
        if len(s.pixels):
            motions.plot(np.sort(s.pixels)[::-1], np.linspace(0, 1, len(s.pixels)), style, color=colour)
        if s.spread.pairs:
            pairs.plot(s.spread.motion[0][::-1], np.linspace(0, 1, 101), style, color=colour)
    overlaps.set(xscale="log", ylim=(0, 1.02), xlabel="frames apart", ylabel="overlap (median, quartiles)")
    overlaps.set_xticks(GAPS, [str(gap) for gap in GAPS])
    overlaps.minorticks_off()
    for level in (TRAINING, 0.5):
        overlaps.axhline(level, color="0.6", linewidth=0.7, linestyle=":")
    reaches.set(
        ylim=(0, 1.02), xlabel=f"later frames of overlap >= {TRAINING:g}", ylabel="fraction of frames with more"
    )
    motions.set(ylim=(0, 1.02), xlabel="motion to the next frame (pixels)", ylabel="fraction of frames with more")
    label = f"motion in pairs of overlap >= {TRAINING:g} (pixels)"
    pairs.set(ylim=(0, 1.02), xlabel=label, ylabel="fraction of pairs with more")
    for axes in (overlaps, reaches, motions, pairs):
        clean(axes)
    title = "" if len(shown) == len(stats) else f"the first {SHOWN} of {len(stats)} sequences"
    figure.legend(loc="outside lower center", ncols=3, fontsize=7, title=title or None, title_fontsize=7)
    return figure

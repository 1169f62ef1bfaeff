"""Overlap index against bare forth-and-back KLT on as many points, and its memory against the length of the video."""

from __future__ import annotations

import time
import tracemalloc

import cv2
import numpy as np
from frames_to_use import Film, frames_from_arguments

from sips_lit.pairs.overlap import OverlapParameters, measure_overlap
from sips_lit.tracking.klt import KltTracker


def bare_klt(film: Film, count: int) -> float:
    """Seconds per frame of forward-backward tracking of ``count`` points."""
    tracker = KltTracker()
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, tracker.iterations, tracker.accuracy)
    options = {"winSize": (tracker.window, tracker.window), "maxLevel": tracker.max_level, "criteria": stop}
    points = cv2.goodFeaturesToTrack(film.frames[0], count, 1e-6, 2).reshape(-1, 2)
    points = np.resize(points, (count, 2)).astype(np.float32)
    start = time.perf_counter()
    for before, after in zip(film.frames[:-1], film.frames[1:], strict=True):
        forth, _, _ = cv2.calcOpticalFlowPyrLK(before, after, points, None, **options)
        cv2.calcOpticalFlowPyrLK(after, before, forth, None, **options)
    return (time.perf_counter() - start) / (len(film) - 1)


def index_time(film: Film) -> tuple[float, float]:
    """Seconds per frame of the whole index, and points per frame."""
    start = time.perf_counter()
    index = measure_overlap(film, OverlapParameters())
    return (time.perf_counter() - start) / (len(film) - 1), float(index.points.mean())


def peak_memory(film: Film, times: int) -> int:
    """Bytes that Python and NumPy allocate at most while a film, played forward and backward ``times`` times, is indexed."""
    loop = film.frames + film.frames[-2:0:-1]
    long_film = Film(loop * times, film.name)
    tracemalloc.start()
    measure_overlap(long_film, OverlapParameters(max_span=50))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def main() -> None:
    film = frames_from_arguments(__doc__ or "")
    index_time(film)
    pairs = []
    for _ in range(5):
        own, points = index_time(film)
        bare = bare_klt(film, round(points))
        pairs.append((bare / own, own, bare))
    ratio, own, bare = np.median(pairs, axis=0)
    print(f"{points:.0f} points per frame: index {1 / own:.1f} frames/s, bare KLT {1 / bare:.1f} frames/s")
    print(f"index / bare = {ratio:.2f} (median of 5; wanted: at least 0.60)")
    short, long = peak_memory(film, 2), peak_memory(film, 8)
    print(
        f"peak memory: {short / 1e6:.2f} MB for a video, {long / 1e6:.2f} MB for one four times as long (frames: none held)"
    )


if __name__ == "__main__":
    main()

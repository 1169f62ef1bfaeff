"""Frames per second of a data set's loader against bare cv2.imread of the same files, in one run.

What a loader rectifies, corrects or resizes it keeps in a cache: measured is the second reading.

python benchmarks/loaders.py ../shared/data/kitti_odometry kitti
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tabulate import tabulate

from sips_lit.types import ImageSequence

ROUNDS = 10
NAMES = ("kitti", "euroc", "posed_depth", "tum_mono", "robotcar", "hpatches", "rgbd", "folder")


class OpenedFiles:
    """The image files that Python opens while it is recording: what the loader reads for a frame."""

    def __init__(self) -> None:
        self.files: list[str] = []
        self.recording = False
        sys.addaudithook(self._note)

    def _note(self, event: str, arguments: tuple[Any, ...]) -> None:
        if (
            self.recording
            and event == "open"
            and Path(str(arguments[0])).suffix.lower() in (".png", ".jpg", ".jpeg", ".ppm")
        ):
            self.files.append(str(arguments[0]))

    def of_frame(self, sequence: ImageSequence, index: int) -> list[str]:
        """The image files that ``frame(index)`` opens."""
        self.files, self.recording = [], True
        sequence.frame(index)
        self.recording = False
        return self.files


def seconds(action: Callable[[Any], object], item: object) -> tuple[float, float]:
    """Of the clock, and of all cores; the latter hardly depends on what else runs."""
    start, start_cores = time.perf_counter(), time.process_time()
    action(item)
    return time.perf_counter() - start, time.process_time() - start_cores


def imread(file: str) -> object:
    return cv2.imread(file, cv2.IMREAD_GRAYSCALE)


def compare(sequence: ImageSequence, uncached: ImageSequence, opened: OpenedFiles, most: int) -> list[object]:
    """Name, size, frames, then frames per second of the loader and of imread, and their ratios.

    The two take turns frame by frame, so that other load falls on both alike; the best round of each frame counts.
    """
    frames = list(range(min(most, len(sequence))))
    sequence.frame(0)  # what is made once per sequence is not the frames' cost
    files = [opened.of_frame(uncached, index) for index in frames]
    if any(len(of_frame) != 1 for of_frame in files):
        raise SystemExit(
            f"{sequence.name}: a frame opens {sorted(map(len, files))[-1]} image files, not one: nothing to compare"
        )
    for index in frames:
        sequence.frame(index)  # a cache, if there is one, is filled
    times = np.zeros((ROUNDS, len(frames), 2, 2))
    for turn in range(ROUNDS):
        for i, ((file,), index) in enumerate(zip(files, frames, strict=True)):
            pair = [(0, sequence.frame, index), (1, imread, file)]
            for column, action, item in pair if turn % 2 else reversed(pair):  # the second finds the file warm
                times[turn, i, column] = seconds(action, item)
    speeds, core_speeds = len(frames) / times.min(0).sum(0).T
    height, width = sequence.frame(0).shape
    return [
        sequence.name,
        f"{width}x{height}",
        len(frames),
        *speeds,
        speeds[0] / speeds[1],
        core_speeds[0] / core_speeds[1],
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", help="the data set's folder")
    parser.add_argument("data", choices=NAMES, help="which loader")
    parser.add_argument("--frames", type=int, default=50, help="of each sequence at most")
    parser.add_argument("--option", action="append", default=[], help="of the loader, as max_side=640; may be repeated")
    arguments = parser.parse_args()
    options = {
        key: int(value) if value.isdecimal() else value for key, value in (o.split("=", 1) for o in arguments.option)
    }
    loader = getattr(importlib.import_module(f"sips_lit.datasets.{arguments.data}"), arguments.data)
    opened = OpenedFiles()
    with tempfile.TemporaryDirectory() as folder:
        cache = {"cache_dir": folder} if "cache_dir" in inspect.signature(loader).parameters else {}
        both = zip(loader(arguments.path, **options, **cache), loader(arguments.path, **options), strict=True)
        rows = [compare(sequence, uncached, opened, arguments.frames) for sequence, uncached in both]
    print(
        tabulate(
            rows,
            ["sequence", "size", "frames", "loader f/s", "imread f/s", "ratio", "ratio of CPU time"],
            floatfmt=".2f",
        )
    )


if __name__ == "__main__":
    main()

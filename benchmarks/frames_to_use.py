"""Frames for the benchmarks: a folder given on the command line, or a flight over a photograph."""

from __future__ import annotations

import argparse

from sips_lit.datasets.demo import demo_stills
from sips_lit.datasets.virtual_flight import flights_over
from sips_lit.frames.folder import folder
from sips_lit.types import GreyImage, ImageSequence


class Film(ImageSequence):
    """Frames from an array, without any known geometry."""

    def __init__(self, frames: list[GreyImage], name: str) -> None:
        self.frames, self.name, self.fingerprint = frames, name, f"{name}{len(frames)}"

    def __len__(self) -> int:
        return len(self.frames)

    def frame(self, index: int) -> GreyImage:
        return self.frames[index]


def frames_from_arguments(description: str, most: int = 60) -> Film:
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument(
        "folder", nargs="?", help="images of a moving camera; default: a flight over a photograph, 640x480"
    )
    arguments = parser.parse_args()
    if arguments.folder:
        whole = folder(arguments.folder)[0]
    else:
        whole = flights_over(demo_stills(["coffee"]), size=(640, 480), length=most, flights_per_still=1)[0]
    frames = [whole.frame(index) for index in range(min(most, len(whole)))]
    print(f"{whole.name}: {len(frames)} frames of {frames[0].shape[1]}x{frames[0].shape[0]}")
    return Film(frames, whole.name)

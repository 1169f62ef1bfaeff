"""Small videos for the tests, and what is in them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sips_lit.frames.video import video
from sips_lit.types import GreyImage, ImageSequence


def write_video(path: Path, frames: Sequence[GreyImage], codec: str = "MJPG") -> Path:
    """A grey video of these frames, as good as the codec allows."""
    height, width = frames[0].shape
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), 10, (width, height))
    assert writer.isOpened()
    for frame in frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def decoded(path: Path) -> list[GreyImage]:
    """All frames of a video, by a loop that is plainly right."""
    capture = cv2.VideoCapture(str(path))
    frames = []
    while True:
        got, image = capture.read()
        if not got:
            return frames
        frames.append(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8))


def frames_of(sequence: ImageSequence) -> list[GreyImage]:
    return [sequence.frame(i) for i in range(len(sequence))]


def one(path: Path, cache: Path, **parameters: Any) -> list[GreyImage]:
    """The frames of a video that is one shot, by way of the cache."""
    (shot,) = video(path, cache, **parameters)
    return frames_of(shot)

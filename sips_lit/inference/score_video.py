"""A video of what a detector sees: each frame beside its score map, with the best points on both."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from sips_lit.errors import BadInputError
from sips_lit.files import make_folder
from sips_lit.inference.writers import name_video
from sips_lit.progress import progress
from sips_lit.render.canvas import Picture, draw_point, probability_colours
from sips_lit.render.points import RADIUS, draw_points
from sips_lit.types import Detector, GreyImage, ImageSequence, Keypoints

_POINT = (255, 120, 60)  # seen on all of viridis


def write_score_video(
    path: Path,
    sequence: ImageSequence,
    detector: Detector,
    n: int = 50,
    max_frames: int | None = None,
    fps: float = 10.0,
) -> int:
    """Writes an mp4 of the first ``max_frames`` frames (None = all), every frame detected on its own; returns how many.

    Detectors without a score map are shown by their ``n`` points alone. The file gets its name when it is whole, as half
    an mp4 plays nowhere; OpenCV's encoder takes even sizes only, so an odd last row or column is not in it. Raises
    BadInputError when the sequence has no frames or frames of different sizes, or the video cannot be written.
    """
    count = len(sequence) if max_frames is None else min(max_frames, len(sequence))
    if count < 1:
        raise BadInputError(f"a video of {count} frames of {sequence.name} cannot be: ask for at least one")
    make_folder(path.parent)
    unfinished = path.with_name(f".{path.stem}.unfinished{path.suffix}")
    first = draw_scores(sequence.frame(0), detector, n)
    size = first.shape[1], first.shape[0]
    video = cv2.VideoWriter(str(unfinished), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"mp4v"), fps, size)
    if not video.isOpened():
        raise BadInputError(
            f"cannot write a video of {size[0]}x{size[1]} pixels to {path}: give a name that ends in .mp4"
        )
    try:
        for index in progress(range(count), desc=f"video of {sequence.name}", unit="frame"):
            picture = first if index == 0 else draw_scores(sequence.frame(index), detector, n)
            if picture.shape != first.shape:
                raise BadInputError(
                    f"frame {index} of {sequence.name} differs in size from the first: no video can show both"
                )
            video.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
        video.release()
        name_video(unfinished, path, count)
    finally:
        video.release()
        unfinished.unlink(missing_ok=True)
    return count


def draw_scores(image: GreyImage, detector: Detector, n: int) -> Picture:
    """The image (H, W) with its ``n`` best points and, on its right, its score map with the same: RGB (H, 2 W, 3).

    Only the left half, (H, W, 3), for a detector without a score map.
    """
    keypoints = detector.detect(image, n)
    left = draw_points(image, keypoints)
    scores = detector.score_map(image)
    if scores is None:
        return left
    return np.concatenate([left, _on_scores(probability_colours(scores), keypoints)], axis=1)


def _on_scores(picture: Picture, keypoints: Keypoints) -> Picture:
    for index in reversed(range(len(keypoints))):
        radius = RADIUS * float(keypoints.scale[index])
        draw_point(picture, keypoints.xy[index], radius, float(keypoints.score[index]), _POINT)
    return picture

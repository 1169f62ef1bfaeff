"""Detection in many frames: stream in, points within the budget out."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from sips_lit.detect.budget import Budget
from sips_lit.detect.recalibration import AS_TRAINED, Recalibration
from sips_lit.inference.streams import FrameStream
from sips_lit.inference.writers import PointWriter
from sips_lit.progress import progress
from sips_lit.types import Detector


@dataclass(slots=True)
class DetectionSummary:
    """What was done so far: ``frames``, ``points`` in all of them, and ``short``, frames with too few for k inliers."""

    frames: int = 0
    points: int = 0
    short: int = 0


def detect_stream(
    detector: Detector,
    stream: FrameStream,
    budget: Budget,
    writers: Sequence[PointWriter],
    summary: DetectionSummary,
    recalibration: Recalibration = AS_TRAINED,
) -> None:
    """Detects in each frame and hands the points to every writer; ``summary`` is kept up to date after each frame.

    ``recalibration`` is that of the detector. Writers are closed at the end, whatever happens: what was written before an
    error stays. Memory does not grow with the number of frames. Raises BadInputError at the first frame that cannot be read
    or written.
    """
    with ExitStack() as stack:
        for writer in writers:
            stack.callback(writer.close)
        for frame in progress(stream, desc="detection", unit="frame", total=stream.total):
            keypoints, enough = budget.keep(detector.detect(frame.grey, budget.candidates), recalibration)
            for writer in writers:
                writer.write(frame, keypoints)
            summary.frames += 1
            summary.points += len(keypoints)
            summary.short += not enough

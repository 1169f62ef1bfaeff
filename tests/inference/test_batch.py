from collections.abc import Iterator

import numpy as np
import pytest
from textured_scenes import keypoints

from sips_lit.detect.budget import Budget
from sips_lit.errors import BadInputError
from sips_lit.inference.batch import DetectionSummary, detect_stream
from sips_lit.inference.streams import Frame, FrameStream
from sips_lit.types import GreyImage, Keypoints


class Stream(FrameStream):
    """Frames of the numbers given, each as the grey value; None cannot be read."""

    total, fps = None, None

    def __init__(self, *values: int | None) -> None:
        self.values, self.alive = values, 0

    def __iter__(self) -> Iterator[Frame]:
        for value in self.values:
            if value is None:
                raise BadInputError("this frame is damaged")
            image = np.full((9, 9), value, np.uint8)
            self.alive += 1
            yield Frame(str(value), image, image)


class Counting:
    """Finds as many points as the grey value says, or all that are asked for, with probability 0.9 each."""

    name, describes = "counting", False

    def __init__(self) -> None:
        self.asked: list[int] = []

    def detect(self, image: GreyImage, n: int) -> Keypoints:
        self.asked.append(n)
        found = min(n, int(image[0, 0]))
        return keypoints(np.zeros((found, 2)), np.full(found, 0.9))


class Memory:
    """Remembers how many points each frame has; refuses the frame named ``refuses``."""

    def __init__(self, refuses: str = "") -> None:
        self.points: dict[str, int] = {}
        self.refuses, self.closed = refuses, 0

    @property
    def written(self) -> str:
        return f"{len(self.points)} frames"

    def write(self, frame: Frame, keypoints: Keypoints) -> None:
        if frame.name == self.refuses:
            raise BadInputError("the disk is full")
        self.points[frame.name] = len(keypoints)

    def close(self) -> None:
        self.closed += 1


def test_every_frame_goes_to_every_writer():
    detector, writers, summary = Counting(), [Memory(), Memory()], DetectionSummary()
    detect_stream(detector, Stream(3, 80, 0), Budget(n=50), writers, summary)
    assert detector.asked == [50, 50, 50]
    for writer in writers:
        assert writer.points == {"3": 3, "80": 50, "0": 0}
        assert writer.closed == 1
    assert summary == DetectionSummary(frames=3, points=53, short=0)


def test_frames_with_too_few_points_are_counted():
    detector, writer, summary = Counting(), Memory(), DetectionSummary()
    detect_stream(detector, Stream(3, 80, 12), Budget(k=4, confidence=0.95, n_max=60), [writer], summary)
    assert detector.asked == [60, 60, 60]
    # of 6 points with 0.9 each, 4 are inliers with probability 0.984; of 5 with 0.919
    assert writer.points == {"3": 3, "80": 6, "12": 6}
    assert summary == DetectionSummary(frames=3, points=15, short=1)


def test_what_was_done_before_a_damaged_frame_stays():
    writers, summary = [Memory(), Memory()], DetectionSummary()
    with pytest.raises(BadInputError, match="this frame is damaged"):
        detect_stream(Counting(), Stream(3, None, 5), Budget(), writers, summary)
    assert summary.frames == 1
    for writer in writers:
        assert writer.points == {"3": 3}
        assert writer.closed == 1


def test_a_writer_that_fails_closes_all():
    writers, summary = [Memory(), Memory(refuses="5")], DetectionSummary()
    with pytest.raises(BadInputError, match="the disk is full"):
        detect_stream(Counting(), Stream(3, 5, 7), Budget(), writers, summary)
    assert [writer.closed for writer in writers] == [1, 1]
    assert summary == DetectionSummary(frames=1, points=3, short=0)


def test_frames_are_read_one_at_a_time():
    stream, seen = Stream(1, 2, 3), []

    class Watching(Memory):
        def write(self, frame: Frame, keypoints: Keypoints) -> None:
            seen.append(stream.alive)

    detect_stream(Counting(), stream, Budget(), [Watching()], DetectionSummary())
    assert seen == [1, 2, 3]


def test_no_frames_and_no_writers():
    writer, summary = Memory(), DetectionSummary()
    detect_stream(Counting(), Stream(), Budget(), [writer], summary)
    detect_stream(Counting(), Stream(4), Budget(), [], summary)
    assert writer.closed == 1
    assert summary.frames == 1

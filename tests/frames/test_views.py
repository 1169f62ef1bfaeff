import inspect

import numpy as np
import pytest
from textured_scenes import ArraySequence, flight

from sips_lit.errors import BadInputError
from sips_lit.frames.views import FrameRange, SequenceView, frame_ranges
from sips_lit.types import Camera, ImageSequence


def numbered(length: int, name: str = "walk") -> ArraySequence:
    """Frame i is an image of the value i."""
    return ArraySequence([np.full((3, 4), i, np.uint8) for i in range(length)], name)


class Knowing(ArraySequence):
    """Tells by each answer which frame it was asked for."""

    def camera(self, index):
        return Camera(np.eye(3) * index, (4, 3))

    def pose(self, index):
        return np.eye(4) * index

    def depth(self, index):
        return np.full((3, 4), index + 0.5)

    def right(self, index):
        return np.full((3, 4), 100 + index, np.uint8)


def test_a_range_shows_the_frames_of_the_whole():
    whole = numbered(10)
    part = FrameRange(whole, 4, 7)
    assert len(part) == 3
    assert [int(part.frame(i)[0, 0]) for i in range(3)] == [4, 5, 6]
    assert part.frame_name(2) == whole.frame_name(6)
    assert part.camera(0) is part.pose(0) is part.depth(0) is part.right(0) is part.homography(0, 1) is None


def test_a_range_knows_what_the_whole_knows():
    scene = flight(8)
    part = FrameRange(Knowing(scene.frames, "k", scene.to_frame), 3, 8)
    assert part.camera(1).matrix[0, 0] == part.pose(1)[0, 0] == 4
    assert part.depth(1)[0, 0] == 4.5
    assert part.right(1)[0, 0] == 104
    np.testing.assert_array_equal(part.homography(0, 4), scene.homography(3, 7))


@pytest.mark.parametrize("index", [-1, 3, 100])
def test_frames_outside_the_range_are_refused(index):
    part = FrameRange(numbered(10), 4, 7)
    for ask in (part.frame, part.frame_name, part.pose, part.camera, part.depth, part.right):
        with pytest.raises(IndexError, match=f"frame {index} of 3"):
            ask(index)
    with pytest.raises(IndexError):
        part.homography(0, index)


def test_names_and_fingerprints_are_of_the_range():
    whole = numbered(10)
    parts = [FrameRange(whole, 0, 5), FrameRange(whole, 5, 10), FrameRange(whole, 0, 6), FrameRange(numbered(9), 0, 5)]
    assert len({part.fingerprint for part in parts}) == 4
    assert len({part.name for part in parts[:3]}) == 3
    assert FrameRange(numbered(10), 0, 5).fingerprint == parts[0].fingerprint
    assert "/" not in parts[0].name


def test_ranges_by_fractions():
    parts = frame_ranges([numbered(10), numbered(1), numbered(4)], 0.25, 0.75)
    assert [(part.start, part.stop) for part in parts] == [(2, 8), (1, 3)]
    assert frame_ranges([numbered(10)], 0, 1)[0].stop == 10


@pytest.mark.parametrize(("start", "stop"), [(0.5, 0.5), (0.6, 0.4), (-0.1, 1), (0, 1.1)])
def test_impossible_ranges(start, stop):
    with pytest.raises(BadInputError, match="0 <= start < stop <= 1"):
        frame_ranges([numbered(10)], start, stop)


class Echo(ImageSequence):
    """Answers every question with the question."""

    name = fingerprint = "echo"
    temporal = False

    def __len__(self):
        return 10

    def frame(self, index):
        return "frame", index


QUESTIONS = [
    name
    for name in vars(ImageSequence)
    if not name.startswith("_") and name not in ("temporal", "damage", "source_range")
]
for name in QUESTIONS:
    setattr(Echo, name, lambda self, *indices, name=name: (name, *indices))


@pytest.mark.parametrize("question", QUESTIONS)
@pytest.mark.parametrize(
    ("view", "offset"),
    [(SequenceView(Echo()), 0), (FrameRange(Echo(), 3, 8), 3), (FrameRange(FrameRange(Echo(), 2, 9), 1, 5), 3)],
)
def test_every_question_is_passed_on_about_the_right_frames(view, offset, question):
    count = len(inspect.signature(getattr(ImageSequence, question)).parameters) - 1
    indices = list(range(1, 1 + count))
    assert getattr(view, question)(*indices) == (question, *(offset + index for index in indices))


def test_a_view_is_known_as_the_whole():
    whole = numbered(10)
    view = SequenceView(whole)
    assert (len(view), view.name, view.fingerprint, view.temporal) == (10, whole.name, whole.fingerprint, True)
    assert view.damage is None
    whole.damage = "half of it is missing"
    assert SequenceView(whole).damage == FrameRange(whole, 0, 3).damage == "half of it is missing"
    assert not SequenceView(Echo()).temporal
    assert not FrameRange(Echo(), 0, 3).temporal


def test_where_the_frames_of_a_range_are():
    whole = numbered(10)
    outer = FrameRange(whole, 2, 9)
    assert whole.source_range() == (whole, 0, 10)
    assert outer.source_range() == (whole, 2, 9)
    inner = FrameRange(outer, 1, 5)
    source, start, stop = inner.source_range()
    assert source is whole
    assert [int(whole.frame(i)[0, 0]) for i in range(start, stop)] == [int(inner.frame(i)[0, 0]) for i in range(4)]

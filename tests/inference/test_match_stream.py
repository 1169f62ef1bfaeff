import itertools

import cv2
import numpy as np
import pytest
from textured_scenes import flight
from tiny_network import tiny_detector

from sips_lit.errors import BadInputError
from sips_lit.inference.match import PairMatcher, match
from sips_lit.inference.match_stream import TwoImages, match_stream
from sips_lit.inference.streams import Frame, FrameStream

FRAMES = flight(7, size=(128, 96)).frames


class Stream(FrameStream):
    total, fps = None, None

    def __init__(self, count: int) -> None:
        self.count = count

    def __iter__(self):
        for index in range(self.count):
            yield Frame(f"f{index}", FRAMES[index], FRAMES[index])


class Counting:
    """Says how often it was asked."""

    def __init__(self) -> None:
        self.inner, self.calls = tiny_detector(), 0
        self.name, self.describes, self.scores = "counting", False, "probability"

    def detect(self, image, n):
        self.calls += 1
        return self.inner.detect(image, n)


@pytest.mark.parametrize(("stride", "pairs"), [(1, 6), (2, 3), (3, 2), (6, 1)])
def test_each_frame_with_the_one_before_and_looked_at_once(stride, pairs):
    detector = Counting()
    found = list(match_stream(PairMatcher(detector, n=40), Stream(7), stride))
    starts = range(0, 7, stride)
    assert [named.name for named in found] == [f"f{a}-f{b}" for a, b in itertools.pairwise(starts)]
    assert len(found) == pairs
    assert detector.calls == pairs + 1
    expected = match(FRAMES[0], FRAMES[stride], 40, tiny_detector())
    np.testing.assert_array_equal(found[0].pair.xy0, expected.xy0)
    np.testing.assert_array_equal(found[0].pair.homography, expected.homography)


@pytest.mark.parametrize(("count", "stride", "reason"), [(7, 0, "stride is 0"), (7, 7, "7 apart"), (0, 1, "1 apart")])
def test_nothing_to_match(count, stride, reason):
    with pytest.raises(BadInputError, match=reason):
        list(match_stream(PairMatcher(tiny_detector()), Stream(count), stride))


def test_two_images_may_have_one_name(tmp_path):
    for folder, frame in zip(("x", "y"), FRAMES, strict=False):
        (tmp_path / folder).mkdir()
        cv2.imwrite(str(tmp_path / folder / "1.png"), frame)
    (named,) = match_stream(PairMatcher(tiny_detector()), TwoImages(tmp_path / "x/1.png", tmp_path / "y/1.png"))
    assert named.name == "1-1"
    np.testing.assert_array_equal(named.pair.image1, FRAMES[1])

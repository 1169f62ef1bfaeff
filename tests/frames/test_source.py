import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from textured_scenes import ArraySequence, flight

from sips_lit.errors import BadInputError
from sips_lit.frames.source import FrameRange, Source, as_sources, frame_ranges, mixture, split_tail
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.types import Camera


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


def test_mixture_names_its_sources_and_leaves_out_null():
    flights, videos = Source([numbered(3)], 2.0, HomographyInliers()), Source([numbered(4)])
    mixed = mixture({"flights": flights, "nothing": None, "videos": videos})
    assert [source.name for source in mixed] == ["flights", "videos"]
    assert mixed[0].weight == 2.0
    assert mixed[0].inliers == HomographyInliers()
    assert mixed[0].sequences is flights.sequences
    assert mixture({}) == []


@pytest.mark.parametrize("weight", [0, -1, float("nan")])
def test_weights_must_be_positive(weight):
    with pytest.raises(BadInputError, match=r"the weight of a source is .*; make it positive"):
        Source([numbered(3)], weight)


def test_sequences_become_one_source():
    sequences = [numbered(3), numbered(4)]
    (source,) = as_sources(sequences)
    assert (source.sequences, source.weight, source.inliers) == (sequences, 1.0, None)


def test_sources_stay_and_empty_ones_are_left_out():
    one, two = Source([numbered(3)], name="one"), Source([numbered(4)], name="two")
    assert as_sources([one, Source([]), two]) == [one, two]


@pytest.mark.parametrize("data", [[], [Source([])]])
def test_no_data_at_all(data):
    with pytest.raises(BadInputError, match="the data has no sequence"):
        as_sources(data)


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


@given(st.lists(st.integers(0, 60), min_size=1, max_size=4), st.floats(0.01, 0.99))
@settings(max_examples=100, deadline=None)
def test_a_split_is_disjoint_and_complete(lengths, fraction):
    sources = [Source([numbered(n, f"s{i}") for i, n in enumerate(lengths)], 3.0, HomographyInliers(), "mine")]
    training, validation = split_tail(sources, fraction)
    for i, n in enumerate(lengths):
        train, val = (
            [part for source in side for part in source.sequences if part.whole.name == f"s{i}"]
            for side in (training, validation)
        )
        frames = [list(range(part.start, part.stop)) for part in [*train, *val]]
        assert all(len(part) >= 2 for part in frames)
        flat = [frame for part in frames for frame in part]
        assert len(set(flat)) == len(flat)
        assert set(flat) <= set(range(n))
        if len(frames) == 2:
            assert flat == list(range(n))
            assert len(frames[1]) == pytest.approx(fraction * n, abs=0.51)
        else:
            cut = round((1 - fraction) * n)  # a part of one frame is no sequence
            assert min(cut, n - cut) < 2
            assert flat == [frame for part in (range(cut), range(cut, n)) if len(part) >= 2 for frame in part]
    for source in [*training, *validation]:
        assert (source.weight, source.inliers, source.name) == (3.0, HomographyInliers(), "mine")


@pytest.mark.parametrize("fraction", [0, 1, -0.2, 1.5, float("nan")])
def test_fractions_between_0_and_1_only(fraction):
    with pytest.raises(BadInputError, match="must lie between 0 and 1"):
        split_tail([Source([numbered(9)])], fraction)


def test_ranges_by_fractions():
    parts = frame_ranges([numbered(10), numbered(1), numbered(4)], 0.25, 0.75)
    assert [(part.start, part.stop) for part in parts] == [(2, 8), (1, 3)]
    assert frame_ranges([numbered(10)], 0, 1)[0].stop == 10


@pytest.mark.parametrize(("start", "stop"), [(0.5, 0.5), (0.6, 0.4), (-0.1, 1), (0, 1.1)])
def test_impossible_ranges(start, stop):
    with pytest.raises(BadInputError, match="0 <= start < stop <= 1"):
        frame_ranges([numbered(10)], start, stop)

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from textured_scenes import ArraySequence

from sips_lit.errors import BadInputError
from sips_lit.frames.source import Source, as_sources, mixture, split_tail
from sips_lit.inliers.homography import HomographyInliers


def numbered(length: int, name: str = "walk") -> ArraySequence:
    """Frame i is an image of the value i."""
    return ArraySequence([np.full((3, 4), i, np.uint8) for i in range(length)], name)


def test_mixture_names_its_sources_and_leaves_out_null():
    flights, videos = Source([numbered(3)], 2.0, HomographyInliers()), Source([numbered(4)])
    mixed = mixture({"flights": flights, "nothing": None, "videos": videos})
    assert [source.name for source in mixed] == ["flights", "videos"]
    assert mixed[0].weight == 2.0
    assert mixed[0].inliers == HomographyInliers()
    assert mixed[0].sequences is flights.sequences
    assert mixture({}) == []


def test_a_mixture_of_some_of_its_sources():
    sources = {name: Source([numbered(3)]) for name in ("drives", "desk", "boards")} | {"nothing": None}

    def names(**which: list[str]) -> list[str]:
        return [source.name for source in mixture(sources, **which)]

    assert names(without=["desk"]) == ["drives", "boards"]
    assert names(only=["boards", "desk"]) == ["desk", "boards"]
    assert names(only=[]) == []
    assert names(only=["desk", "nothing"], without=["nothing"]) == ["desk"]
    for which in ({"only": ["planes"]}, {"without": ["desk", "planes"]}):
        with pytest.raises(BadInputError, match="no source planes: choose among drives, desk, boards, nothing"):
            mixture(sources, **which)


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

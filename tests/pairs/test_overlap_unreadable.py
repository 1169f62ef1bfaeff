"""Frames that can't be read."""

import itertools

import numpy as np
import pytest
from overlap_rows import rows_of
from overlap_scenes import views
from textured_scenes import ArraySequence, Damaged, film, flight

from sips_lit.errors import BadInputError
from sips_lit.pairs.overlap import OverlapParameters, measure_overlap


@pytest.mark.parametrize("bad", [(4,), (0,), (8,), (0, 1), (3, 4), (2, 5, 8)])
def test_an_unreadable_frame_is_a_break(bad):
    whole = film(9)
    damaged = Damaged(whole.frames)
    damaged.bad = bad
    index = measure_overlap(damaged, OverlapParameters())
    assert index.unreadable == {i: f"{i}.png is damaged" for i in bad}
    rows, ends = rows_of(index), (-1, *bad, 9)
    for before, after in itertools.pairwise(ends):  # between two breaks: as if nothing else were there
        alone = measure_overlap(ArraySequence(whole.frames[before + 1 : after]), OverlapParameters())
        assert rows[before + 1 : after] == rows_of(alone)
        np.testing.assert_array_equal(index.points[before + 1 : after], alone.points)
    for i in bad:
        assert index.points[i] == 0
        assert rows[i] == []


@pytest.mark.parametrize("bad", [(0,), (2,), (0, 2)])
def test_an_unreadable_view_is_in_no_pair(bad):
    whole = views(*[(10 * i, 5 * i, 160, 120) for i in range(5)])

    class DamagedViews(Damaged):
        temporal = False

    damaged = DamagedViews(whole.frames, "views", whole.to_frame)
    damaged.bad = bad
    index, undamaged = (measure_overlap(sequence, OverlapParameters()) for sequence in (damaged, whole))
    assert index.unreadable == {i: f"{i}.png is damaged" for i in bad}
    for i in range(5):
        expected = [] if i in bad else [j for j in undamaged.partners(i, 0.3) if j not in bad]
        assert index.partners(i, 0.3).tolist() == expected


def test_the_size_of_a_planar_flight_is_that_of_a_frame_that_can_be_read():
    whole = flight(6)
    damaged = Damaged(whole.frames, "flight", whole.to_frame)
    damaged.bad = (0, 1)
    index, undamaged = (measure_overlap(sequence, OverlapParameters()) for sequence in (damaged, whole))
    assert list(index.unreadable) == [0, 1]
    assert not index.reach(0.3)[:2].any()
    assert rows_of(index)[2:] == rows_of(undamaged)[2:]


def test_half_of_the_frames_unreadable_is_too_many():
    damaged = Damaged(film(8).frames, "walk")
    damaged.bad = (1, 3, 6)
    assert len(measure_overlap(damaged, OverlapParameters()).unreadable) == 3
    damaged.bad = (6, 1, 3, 5)
    with pytest.raises(BadInputError, match=r"half of the frames of walk can't be read; the first of them: 1\.png is"):
        measure_overlap(damaged, OverlapParameters())

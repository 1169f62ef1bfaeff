"""What an index tells: reach, partners, difficulty; and its parts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from overlap_rows import index_of, rows_of
from overlap_scenes import SCENES

from sips_lit.pairs.overlap import OverlapParameters, measure_overlap


@given(st.lists(st.lists(st.integers(1, 40), max_size=6), min_size=1, max_size=6), st.floats(0.01, 1.0))
@settings(max_examples=100, deadline=None)
def test_reach_counts_the_frames_with_enough_overlap(rows, overlap):
    rows = [sorted(row, reverse=True) for row in rows]
    points = np.array([max([*row, 1]) for row in rows])
    index = index_of(rows, points)
    for target in (overlap, 0.55, 0.3, 0.1):
        assert index.reach(target).tolist() == [int((index.overlap(i) >= target).sum()) for i in range(len(rows))]


def test_an_overlap_exactly_reached_is_enough():
    for points in range(1, 200):
        for survivors in range(1, points + 1):
            index = index_of([[survivors]], points)
            assert index.reach(survivors / points).tolist() == [1], (survivors, points)


def test_no_overlap_asked_for_is_every_frame_tracked():
    index = index_of([[3, 1], []], [40, 0])
    assert index.reach(0).tolist() == [2, 0]


def test_overlap_within_bounds():
    index = index_of([[10, 6, 5, 3], [9, 6, 1], [5, 2], [0], []])
    assert index.reach(0.3, 0.6).tolist() == [2, 0, 1, 0, 0]
    assert index.partners(0, 0.3, 0.6).tolist() == [3, 4]
    for i in range(5):
        assert len(index.partners(i, 0.3, 0.6)) == index.reach(0.3, 0.6)[i]
    assert (index.reach(0.3, 0.6) + index.reach(0.6)).tolist() == index.reach(0.3).tolist()


def test_the_overlap_is_a_share_of_the_points_of_the_earlier_frame():
    index = index_of([[8, 4], [6], []], [10, 20, 30])
    assert index.overlap(0).tolist() == [0.8, 0.4]
    assert index.overlap(1).tolist() == [0.3]
    assert index.reach(0.3).tolist() == [2, 1, 0]
    assert index.partners(0, 0.4).tolist() == [1, 2]


@pytest.mark.parametrize("scene", SCENES)
def test_parts_of_an_index(scene):
    sequence = SCENES[scene]()
    index = measure_overlap(sequence, OverlapParameters())
    n = len(sequence)
    for start, stop in [(0, n), (0, n // 2), (n // 3, n), (n // 3, n // 2), (n, n)]:
        part = index.part(start, stop)
        expected = [row[: stop - start - i - 1] for i, row in enumerate(rows_of(index)[start:stop])]
        assert rows_of(part) == expected
        np.testing.assert_array_equal(part.points, index.points[start:stop])
        assert part.survivors.dtype == index.survivors.dtype


def test_the_motion_of_a_part_is_that_of_the_whole():
    index = measure_overlap(SCENES["flight"](), OverlapParameters())
    part = index.part(3, 9)
    for i in range(6):
        np.testing.assert_array_equal(part.motion_to(i), index.motion_to(i + 3)[: len(part.overlap(i))])


def test_a_part_tells_of_its_own_unreadable_frames_by_their_numbers_in_it():
    index = index_of([[3, 1], [], [], [2], [], [4], []], unreadable={1: "b", 2: "c", 4: "e", 6: "g"})
    assert index.part(2, 6).unreadable == {0: "c", 2: "e"}
    assert index.part(0, 7).unreadable == index.unreadable
    assert index.part(5, 6).unreadable == {}


def test_difficulty_tells_overlap_distance_turn_and_zoom_apart():
    easy, steps = (
        (10, (2, 0, 0)),
        [(7, (2, 0, 0)), (10, (9, 0, 0)), (10, (300, 0, 0)), (10, (2, 20, 0)), (10, (2, 60, 0))],
    )
    steps += [(10, (2, 0, 0.4)), (10, (2, 0, 1))]
    alike = [(9, (7, -14, 0.2)), (10, (0, 0, -0.2))]
    row = [easy, *alike, *steps]
    index = index_of([[count for count, _ in row], *([] for _ in row)], motion=[motion for _, motion in row])
    difficulty = index.difficulty(0)
    assert len(set(difficulty[:3])) == 1
    assert len(set(difficulty[2:])) == 8
    mirrored = index_of([[10, 10, 10], [], [], []], motion=[(2, -20, -0.4), (2, 20, 0.4), (2, 20, -0.4)])
    assert len(set(mirrored.difficulty(0))) == 1

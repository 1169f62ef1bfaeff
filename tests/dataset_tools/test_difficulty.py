import numpy as np
import pytest
from overlap_rows import index_of
from textured_scenes import flight

from sips_lit.dataset_tools.difficulty import pair_spread
from sips_lit.pairs.overlap import OverlapParameters, measure_overlap


def test_counted_by_hand():
    """Of seven pairs five overlap by 0.1 or more: by 1, 0.8, 0.5, 0.4 and 0.3; two of these are of neighbours."""
    motion = [(2, 0, 0), (8, -10, 1), (99, 90, 9), (16, 20, -1), (32, 5, 0), (99, 90, 9), (4, 0, 0.5)]
    index = index_of([[50, 20, 4], [15, 25, 3], [40], []], 50, motion)
    spread = pair_spread(index)
    assert spread.pairs == 5
    assert spread.classes.tolist() == [0, 1, 2, 0, 2]
    assert spread.neighbours == 3 / 5
    pixels, turn, zoom = spread.motion
    assert pixels[[0, 50, 100]].tolist() == [2, 8, 32]
    assert turn[[0, 50, 100]].tolist() == [0, 5, 20]
    assert zoom[[0, 100]].tolist() == [1, 2]
    assert zoom[50] == pytest.approx(2**0.5)
    assert pixels[90] == pytest.approx(16 + 0.6 * 16)  # between the fourth and the fifth of five
    assert not spread.only_neighbours


@pytest.mark.parametrize(("others", "only"), [(0, True), (1, True), (2, False)])
def test_nine_of_ten_neighbours_are_only_neighbours(others, only):
    rows = [[9, 9 if i < others else 1] for i in range(8)] + [[9], []]
    assert pair_spread(index_of(rows, 20)).only_neighbours == only


def test_without_an_order_there_are_no_neighbours():
    spread = pair_spread(index_of([[9], [9], []], 10), temporal=False)
    assert spread.pairs == 2
    assert np.isnan(spread.neighbours)
    assert not spread.only_neighbours


@pytest.mark.parametrize("rows", [[], [[]], [[5, 4], [4], []]])
def test_no_pair_of_enough_overlap(rows):
    spread = pair_spread(index_of(rows, 60))
    assert spread.pairs == 0
    assert np.isnan(spread.motion).all()
    assert not spread.only_neighbours


def test_as_one_pair_after_the_other():
    index = measure_overlap(flight(9, step=(14, 6), zoom=1.05), OverlapParameters())
    overlap, moved, gaps = [], [], []
    for i in range(9):
        for j in range(i + 1, i + 1 + len(index.overlap(i))):
            if index.overlap(i)[j - i - 1] >= 0.1:
                overlap.append(index.overlap(i)[j - i - 1])
                moved.append(index.motion_to(i)[j - i - 1])
                gaps.append(j - i)
    spread = pair_spread(index)
    assert spread.pairs == len(overlap) == index.reach(0.1).sum() > 10
    assert spread.classes[4] == sum(o >= 0.8 for o in overlap)
    assert spread.neighbours == gaps.count(1) / len(gaps)
    assert spread.motion[0, 50] == pytest.approx(np.median([float(m[0]) for m in moved]))
    assert spread.motion[2, 100] == pytest.approx(2 ** max(abs(float(m[2])) for m in moved))

import math

import numpy as np

from sips_lit.metrics.coverage import Coverage, coverage

# inliers among the n best, n = 0..4, of four images
INLIERS = np.array([[0, 1, 2, 2, 3], [0, 0, 1, 2, 2], [0, 1, 1, 1, 1], [0, 0, 0, 0, 1]])


def test_by_hand():
    found = coverage(0.7, [2, 2, 4, None], INLIERS, 2)
    assert found == Coverage(0.7, 1 / 3, 8 / 3, 2, 3, 1)


def test_a_fixed_number_that_holds_as_often():
    assert coverage(0.9, [2, 3, 2], INLIERS[[0, 1, 0]], 2) == Coverage(0.9, 1.0, 7 / 3, 3, 3, 0)


def test_more_points_than_there_are_count_as_all():
    assert coverage(0.5, [9], INLIERS[:1], 3).observed == 1.0


def test_no_fixed_number_holds_as_often():
    """A match can break as points come in, so the best budgets may differ."""
    broken = np.array([[0, 1, 0], [0, 0, 1]])
    assert coverage(0.5, [1, 2], broken, 1).fixed is None


def test_nothing_promised():
    found = coverage(0.9, [None, None], INLIERS[:2], 2)
    assert math.isnan(found.observed)
    assert math.isnan(found.points)
    assert (found.fixed, found.promised, found.out_of_reach) == (None, 0, 2)

import numpy as np
import pytest

from sips_lit.matching.confidence import distinctness, shared_probability
from sips_lit.matching.mutual_nearest import mutual_nearest
from sips_lit.types import Matches


def test_two_points_that_agree_keep_their_probability():
    np.testing.assert_allclose(shared_probability(np.float32([0.8, 0, 1]), np.float32([0.8, 0.5, 1])), [0.8, 0, 1])
    (between,) = shared_probability(np.float32([0.9]), np.float32([0.4]))
    assert between == pytest.approx(0.6)


def test_distinctness_of_the_worse_side():
    table = np.random.default_rng(0).uniform(0.1, 1, (7, 9)).astype(np.float32)
    matches = mutual_nearest(table)
    expected = []
    for i, j in zip(matches.index0, matches.index1, strict=True):
        ratios = [table[i, j] / sorted(line)[1] for line in (table[i], table[:, j])]
        expected.append(1 - max(ratios))
    assert len(matches) > 2
    np.testing.assert_allclose(distinctness(table, matches), expected, rtol=1e-5)


def test_nothing_to_compare_with_is_no_confidence():
    one = Matches(np.array([0]), np.array([0]))
    for table in ([[0.1]], [[0.1, 0.2]], [[0.0, 0.0], [0.3, 0.4]]):
        np.testing.assert_array_equal(distinctness(np.array(table, np.float32), one), [0])
    np.testing.assert_allclose(distinctness(np.float32([[0.0, 0.5], [0.5, 0.4]]), one), [1])
    none = np.zeros(0, np.int64)
    assert distinctness(np.zeros((0, 3), np.float32), Matches(none, none)).shape == (0,)

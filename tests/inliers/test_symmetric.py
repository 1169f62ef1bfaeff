import itertools

import numpy as np
import pytest

from sips_lit.inliers.point_labels import symmetric
from sips_lit.types import Matches, Reason

I, L, F, U = Reason.INLIER, Reason.LOST, Reason.FAR, Reason.UNKNOWN  # noqa: E741 - a column of a table
TABLE = [
    (I, I, I), (I, L, L), (I, F, F), (I, U, I),
    (L, I, L), (L, L, L), (L, F, L), (L, U, L),
    (F, I, F), (F, L, F), (F, F, F), (F, U, F),
    (U, I, I), (U, L, L), (U, F, F), (U, U, U),
]  # fmt: skip


@pytest.mark.parametrize(("forth", "back", "expected"), TABLE)
def test_every_combination(forth, back, expected):
    one, alone = np.array([0]), np.array([False])
    judged = symmetric(np.array([forth], np.uint8), np.array([back], np.uint8), Matches(one, one), alone, alone)
    assert judged.reason.tolist() == [expected]
    assert judged.inlier.tolist() == [expected == I]
    assert judged.known0.tolist() == judged.known1.tolist() == [expected != U]


def test_the_table_is_complete():
    assert {row[:2] for row in TABLE} == set(itertools.product([I, L, F, U], repeat=2))


def test_points_keep_their_own_knowledge_and_arguments_are_not_changed():
    known0, known1 = np.array([True, False, False]), np.array([False, True])
    matches = Matches(np.array([2]), np.array([0]))
    judged = symmetric(np.array([U], np.uint8), np.array([I], np.uint8), matches, known0, known1)
    assert judged.known0.tolist() == [True, False, True]
    assert judged.known1.tolist() == [True, True]
    assert known0.tolist() == [True, False, False]
    assert known1.tolist() == [False, True]


def test_no_matches():
    none, nothing = np.zeros(0, np.int64), np.zeros(0, np.uint8)
    judged = symmetric(nothing, nothing, Matches(none, none), np.ones(2, bool), np.zeros(3, bool))
    assert len(judged.inlier) == 0
    assert judged.known0.tolist() == [True, True]
    assert judged.known1.tolist() == [False] * 3

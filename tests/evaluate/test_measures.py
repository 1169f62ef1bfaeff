import math

import pytest

from sips_lit.errors import BadInputError
from sips_lit.evaluate.measures import KS, Measures


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"k": 200}, "k is 200 and n_max is 200"),
        ({"k": 0}, "k is 0 and n_max is 200"),
        ({"n": 201}, "n is 201"),
        ({"n": 0}, "n is 0"),
        ({"search": "halves"}, "search is halves: give auto, exact, binary"),
        ({"ks": (5, 5)}, "different numbers"),
        ({"ks": (0,)}, "from 1"),
        ({"budgets": (300,)}, "budgets is .300."),
        ({"budgets": (0,)}, "budgets"),
        ({"repeats": 0}, "repeats is 0: give at least 1"),
        ({"iterations": 0}, "iterations is 0"),
        ({"cells": 0}, "cells is 0"),
        ({"calibration": (0,)}, "calibration is .0."),
        ({"rotation_limit": 0.0}, "rotation_limit is 0.0: give a number above 0"),
        ({"translation_limit": math.inf}, "translation_limit is inf"),
        ({"translation_limit": math.nan}, "translation_limit is nan"),
    ],
)
def test_impossible(options, words):
    with pytest.raises(BadInputError, match=words):
        Measures(**options)


def test_numbers_of_inliers_and_of_points():
    assert Measures().every_k == KS
    assert Measures(k=9, ks=(3, 12), n_max=60).every_k == (3, 9, 12)
    assert Measures(k=9, ks=(9, 50, 60), n_max=50).every_k == (9,)  # 50 inliers of 50 points are not asked for
    assert Measures(n=20, budgets=(70, 20, 5)).every_n == (5, 20, 70)


def test_more_points_are_extracted_for_probabilities_only():
    m = Measures(n_max=60, calibration=(20, 90))
    assert [m.points(scores) for scores in ("probability", "order", "none")] == [90, 60, 60]
    assert Measures(n_max=60, calibration=()).points("probability") == 60


def test_the_protocol_is_plain():
    protocol = Measures(k=9, ks=(3,), n=20, budgets=(5,)).protocol
    assert (protocol["k"], protocol["ks"], protocol["n"], protocol["budgets"]) == (9, [3, 9], 20, [5, 20])
    assert protocol["translation_limit"] == 1.0
    assert protocol["calibration"] == [50, 500]

from dataclasses import replace

import numpy as np
from golden_results import N, golden

from sips_lit.evaluate.result import PoseOutcome
from sips_lit.report.counts import counts, defects, without_pose

FOUND, UNKNOWN, FEW = PoseOutcome.FOUND, PoseOutcome.UNKNOWN, PoseOutcome.FEW_INLIERS


def with_outcomes(*outcomes):
    """The golden result with these outcomes (P, R) of its methods at the n of the table; None: not measured there."""
    result = golden()
    methods = []
    for method, outcome in zip(result.detectors, outcomes, strict=False):
        at = {} if outcome is None else {N: replace(method.budgets[N], outcome=np.array(outcome))}
        methods.append(replace(method, budgets=at))
    return replace(result, detectors=tuple(methods))


def test_a_kind_that_a_method_does_not_count_is_zero():
    result = golden()
    first, second = result.detectors
    methods = replace(first, defects={"images": 4, "outside": 2}), replace(second, defects={"images": 5, "empty": 1})
    table = defects(replace(result, detectors=methods))
    assert table.title == "Defects in what the detectors returned"
    assert table.kinds == ("images", "outside", "empty")
    assert table.rows == {"Alpha + RootSIFT": (4, 2, 0), "Beta": (5, 0, 1)}
    assert defects(replace(result, detectors=methods[:1])).title == "Defects in what the detector returned"


def test_outcomes_are_counted_over_pairs_and_repeats():
    table = without_pose(with_outcomes([[FOUND, FEW], [FEW, FEW]], [[FOUND, FOUND], [UNKNOWN, UNKNOWN]]))
    assert table.title == "Pairs without a pose at 60 points, each in 2 repeats"
    assert table.kinds == ("with a pose", "a pose of few inliers", "truth or depth unknown")
    assert table.rows == {"Alpha + RootSIFT": (1, 3, 0), "Beta": (2, 0, 2)}


def test_a_method_that_was_not_measured_there_is_left_out():
    table = without_pose(with_outcomes([[FOUND], [FEW]], None))
    assert table.title == "Pairs without a pose at 60 points"
    assert table.rows == {"Alpha + RootSIFT": (1, 1)}
    assert without_pose(with_outcomes(None, None)) is None


def test_nothing_to_count():
    assert without_pose(with_outcomes([[UNKNOWN]], [[UNKNOWN]])) is None
    nothing = replace(golden(), detectors=())
    assert counts(nothing) == []
    clean = with_outcomes([[UNKNOWN]])
    assert counts(replace(clean, detectors=(replace(clean.detectors[0], defects={}),))) == []
    assert [table.title for table in counts(clean)] == ["Defects in what the detector returned"]

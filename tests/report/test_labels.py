from dataclasses import replace

import numpy as np
import pytest
from benchmark_examples import detector_result, pair_table

from sips_lit.errors import BadInputError
from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.labels import is_control, labelled, refuse_unknown_labels, styles_of, told_apart

NAMES = ("SIPs + RootSIFT", "SIFT", "SIFT + RootSIFT", "random + RootSIFT")


@pytest.fixture
def result() -> PairSetResult:
    table = pair_table(np.random.default_rng(0), 3)
    return PairSetResult("set", "Set", {}, tuple(detector_result(name, table) for name in NAMES), {})


def names(result: PairSetResult) -> list[str]:
    return [method.name for method in result.detectors]


def test_the_label_of_a_detector_is_in_all_of_its_methods(result):
    found = names(labelled(result, {"sips": "ours", "sift": "SIFT (OpenCV)"}))
    assert found == ["ours + RootSIFT", "SIFT (OpenCV)", "SIFT (OpenCV) + RootSIFT", "random + RootSIFT"]


def test_the_label_of_a_method_is_its_whole_name(result):
    assert names(labelled(result, {"sips_rootsift": "ours", "sift": "old"}))[:3] == ["ours", "old", "old + RootSIFT"]
    assert names(labelled(result, {"sift_rootsift": "mixed"}))[1:3] == ["SIFT", "mixed"]
    assert names(labelled(result, {})) == list(NAMES)


def test_lines_stay_what_they_are_under_a_label(result):
    plain, other = styles_of([result]), styles_of([labelled(result, {"sips_rootsift": "ours", "random": "chance"})])
    assert other["ours"] == plain["SIPs + RootSIFT"]
    assert other["chance + RootSIFT"] == plain["random + RootSIFT"]
    assert [is_control(method) for method in labelled(result, {"random": "chance"}).detectors] == [False] * 3 + [True]


def test_the_same_method_under_two_labels_has_two_colours(result):
    first, second = (replace(result.detectors[0], name=f"{name} + RootSIFT") for name in ("a", "b"))
    styles = styles_of([replace(result, detectors=(first, second))])
    assert styles["a + RootSIFT"].colour != styles["b + RootSIFT"].colour


def test_labels_of_nothing():
    keys = [("sips_rootsift", "RootSIFT"), ("sift", "own")]
    refuse_unknown_labels({"sips": "a", "sips_rootsift": "b", "sift": "c", "gone": "d"}, keys, ["gone"])
    with pytest.raises(
        BadInputError, match=r"labels names sisp, which is no method here: .* to sips, sips_rootsift, sift"
    ):
        refuse_unknown_labels({"sisp": "a"}, keys)


def test_two_of_one_name_are_told_apart(result):
    twin = replace(result.detectors[1], key="twin")
    found = told_apart(replace(result, detectors=(*result.detectors, twin)))
    assert names(found) == ["SIPs + RootSIFT", "SIFT (sift)", *NAMES[2:], "SIFT (twin)"]

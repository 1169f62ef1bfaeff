from dataclasses import replace
from pathlib import Path

import pytest
from benchmark_examples import NAMES, pair_set

from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.columns import auc_of, columns_of
from sips_lit.report.intervals import Intervals, intervals
from sips_lit.report.terminal import fitting_columns, markdown, protocol_line, summary


def test_the_table(measured_flights):
    pairs, measured = measured_flights
    drawn = {"kind": "random", "overlap": 0.5, "seed": 0}
    result = PairSetResult("set", "Set", {**pairs.protocol, **drawn}, tuple(measured), {})
    lines = markdown(result).splitlines()
    aucs = sorted((auc_of(d) for d in measured), reverse=True)
    assert [f"{auc:.3f}" for auc in aucs] == [line.split("|")[5].strip() for line in lines[2:]]
    assert "AUC-60" in lines[0]
    line = protocol_line(result)
    for part in (
        "k = 8, ",
        "at most 60 points",
        "6 pairs (kind=random, overlap=0.5, seed=0)",
        "exact search",
        "threshold=3.0",
    ):
        assert part in line
    assert "inliers=homography" in line
    assert "\n" not in line
    few = {"pairs": 1, "verification": [{"inliers": "stereo_p3p", "stereo": {"max_disparity": 192}}]}
    assert protocol_line(PairSetResult("set", "Set", few, (), {})) == "1 pair, inliers=stereo_p3p"


def test_nobody_was_measured(measured_flights):
    pairs, _ = measured_flights
    result = PairSetResult("set", "Set", pairs.protocol, (), {"gone": "why"})
    assert "method" in summary(result, Intervals(), Path("all.md"))


@pytest.mark.parametrize("longest", [10, 60])
def test_no_line_is_wider_than_a_terminal(longest):
    result = pair_set(repeats=2)
    names = [f"{'long ' * (longest // 5)}{method.name}" for method in result.detectors]
    methods = tuple(replace(method, name=name) for method, name in zip(result.detectors, names, strict=True))
    result = replace(result, detectors=methods)
    estimates = intervals(result, 100)
    text = summary(result, estimates, Path("all.md"))
    assert max(map(len, text.splitlines())) <= 100
    assert "Left out here: " in text
    assert "All columns: all.md" in " ".join(text.split())
    shown, hidden = fitting_columns(result.detectors, estimates)
    assert {"n_at_80", "auc"} <= {column.key for column in shown}
    assert {column.key for column in [*shown, *hidden]} == {column.key for column in columns_of(methods)}
    assert not any(column.key.endswith("_ms") for column in shown)


def test_the_interval_stands_beside_its_number():
    result = pair_set(NAMES[:2], 30, repeats=1)
    estimates = intervals(result, 200)
    best = max(result.detectors, key=auc_of)
    estimate = estimates.of[best.key, "auc"]
    (line,) = [line for line in summary(result, estimates, Path("a")).splitlines() if line.startswith(f"{best.name} ")]
    assert f"{auc_of(best):.3f} [{estimate.low:.3f}, {estimate.high:.3f}]" in line
    assert "In brackets: 95 % intervals, from 200 draws of the pairs." in summary(result, estimates, Path("a"))
    assert "[" not in summary(result, Intervals(), Path("a"))


def test_a_bar_in_a_name_is_no_border():
    result = pair_set(NAMES[:1], 4, poses=False)
    named = replace(result, detectors=(replace(result.detectors[0], name="a|b"),))
    assert r"| a\|b " in markdown(named)

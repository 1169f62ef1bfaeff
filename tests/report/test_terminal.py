from tiny_methods import MEASURES

from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.summary import summary
from sips_lit.report.terminal import protocol_line, table


def test_the_table(measured_flights):
    pairs, measured = measured_flights
    drawn = {"kind": "random", "overlap": 0.5, "seed": 0}
    result = PairSetResult("set", "Set", {**pairs.protocol, **drawn}, tuple(measured), {})
    lines = table(result).splitlines()
    aucs = sorted((summary(d).auc for d in measured), reverse=True)
    assert [f"{auc:.3f}" for auc in aucs] == [line.split("|")[5].strip() for line in lines[2:]]
    assert "AUC-60" in lines[0]
    assert "ms" not in lines[0]
    line = protocol_line(result, MEASURES)
    assert line.startswith("6 pairs (kind=random, overlap=0.5, seed=0), at most 60 points, inliers=homography")


def test_nobody_was_measured(measured_flights):
    pairs, _ = measured_flights
    result = PairSetResult("set", "Set", pairs.protocol, (), {"gone": "why"})
    assert "detector" in table(result)

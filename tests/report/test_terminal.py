from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.columns import auc_of
from sips_lit.report.terminal import protocol_line, table


def test_the_table(measured_flights):
    pairs, measured = measured_flights
    drawn = {"kind": "random", "overlap": 0.5, "seed": 0}
    result = PairSetResult("set", "Set", {**pairs.protocol, **drawn}, tuple(measured), {})
    lines = table(result).splitlines()
    aucs = sorted((auc_of(d) for d in measured), reverse=True)
    assert [f"{auc:.3f}" for auc in aucs] == [line.split("|")[5].strip() for line in lines[2:]]
    assert "AUC-60" in lines[0]
    assert "ms" not in lines[0]
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
    assert "method" in table(result)

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmark_examples import NAMES, pair_set

from sips_lit.errors import BadInputError
from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.columns import auc_of
from sips_lit.report.merging import differences, merge
from sips_lit.report.pair_pictures import PairPicture
from sips_lit.report.restored import Restored

WHOLE = pair_set(NAMES[:3], 12, repeats=1)
PICTURE = PairPicture("best", Path("a.png"), "n_10 = 12")


def only(*keys: str, **changes) -> PairSetResult:
    """The pair set with some of its methods."""
    return replace(WHOLE, detectors=tuple(m for m in WHOLE.detectors if m.key in keys), skipped={}, **changes)


def stored(*results: PairSetResult, name="run", machine=None, pictures=None, date="2026-01-02") -> Restored:
    return Restored(Path(name) / "results.json", results, date, machine or {"cores": "2"}, pictures or {})


def test_methods_of_the_same_pairs_come_into_one_table():
    first, second = only("sips_rootsift"), only("sift", "orb_rootsift")
    merged = merge([stored(first), stored(second)], {})
    (result,) = merged.results
    assert result == replace(first, detectors=(*first.detectors, *second.detectors))
    assert (merged.notes, merged.date, merged.machine) == ((), "2026-01-02", {"cores": "2"})


def test_one_file_stays_what_it_is():
    assert merge([stored(WHOLE)], {}).results == (WHOLE,)


def test_one_method_twice_needs_a_name():
    files = [
        stored(only("sips_rootsift", "sift")),
        stored(only("sips_rootsift"), pictures={("kitti", "sips_rootsift"): [PICTURE]}),
    ]
    with pytest.raises(BadInputError) as refused:
        merge(files, {})
    assert "SIPs + RootSIFT on KITTI odometry 00 is in two of the files" in str(refused.value)
    assert 'labels={2/sips_rootsift: "SIPs + RootSIFT, second"}' in str(refused.value)
    merged = merge(files, {"2/sips": "longer", "sips_rootsift": "ours"})
    (result,) = merged.results
    assert [(m.key, m.name) for m in result.detectors] == [
        ("sips_rootsift", "ours"),
        ("sift", "SIFT"),
        ("sips_rootsift_2", "longer + RootSIFT"),
    ]
    assert merged.pictures == {("kitti", "sips_rootsift_2"): [PICTURE]}


def test_labels_of_nothing():
    with pytest.raises(BadInputError, match=r"labels names 3/sips, which is no method here"):
        merge([stored(WHOLE), stored(WHOLE)], {"3/sips": "x"})


def changed(**protocol) -> PairSetResult:
    result = only("sift")
    methods = tuple(replace(m, protocol=m.protocol | protocol) for m in result.detectors)
    return replace(result, detectors=methods)


def other_pairs() -> PairSetResult:
    result = only("sift")
    table = replace(result.detectors[0].pairs, name=tuple(f"other:{i}-{i + 1}" for i in range(12)))
    return replace(result, detectors=tuple(replace(m, pairs=table) for m in result.detectors))


@pytest.mark.parametrize(
    ("other", "differing"),
    [
        (changed(k=12), "k"),
        (changed(search="exact"), "search"),
        (replace(only("sift"), protocol=WHOLE.protocol | {"verification": []}), "verification"),
        (other_pairs(), "pairs"),
    ],
)
def test_other_pairs_or_another_protocol_stay_apart(other, differing):
    merged = merge([stored(only("sips_rootsift")), stored(other, name="second")], {})
    first, second = merged.results
    assert (first.key, second.key) == ("kitti", "kitti_2")
    assert second.title == "KITTI odometry 00 (second)"
    (note,) = merged.notes
    assert note == f"KITTI odometry 00 of second/results.json has a table of its own, as it differs in {differing}"


def test_versions_and_weights_may_differ():
    assert differences(only("sips_rootsift"), changed(versions={"numpy": "3"}, checkpoint="a", scores="response")) == []
    assert differences(WHOLE, replace(WHOLE, detectors=())) == ["methods"]


def test_several_machines_and_days():
    merged = merge([stored(only("sift")), stored(only("orb_rootsift"), machine={"cores": "8"}, date="2026-02-03")], {})
    assert merged.machine == {"cores (1)": "2", "cores (2)": "8"}
    assert merged.date == "2026-01-02, 2026-02-03"


def test_numbers_stay_those_of_their_methods():
    merged = merge([stored(only("orb_rootsift")), stored(only("sift"))], {"2/sift": "S"})
    by_name = {m.name: auc_of(m) for m in merged.results[0].detectors}
    expected = {m.key: auc_of(m) for m in WHOLE.detectors}
    np.testing.assert_equal(by_name, {"ORB + RootSIFT": expected["orb_rootsift"], "S": expected["sift"]})

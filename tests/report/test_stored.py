import dataclasses
import json
from dataclasses import replace

import numpy as np
import pytest
from benchmark_examples import NAMES, pair_set, pair_table

from sips_lit.errors import BadInputError
from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.stored import load_results, plain, store_results


def same(left: object, right: object) -> None:
    """Equal, also NaN with NaN."""
    if dataclasses.is_dataclass(left):
        assert type(left) is type(right)
        for field in dataclasses.fields(left):
            same(getattr(left, field.name), getattr(right, field.name))
    elif isinstance(left, dict) and any(dataclasses.is_dataclass(v) for v in left.values()):
        assert left.keys() == right.keys()
        for key in left:
            same(left[key], right[key])
    elif isinstance(left, np.ndarray):
        assert left.dtype == right.dtype
        np.testing.assert_array_equal(left, right)
    elif isinstance(left, tuple) and left and dataclasses.is_dataclass(left[0]):
        for a, b in zip(left, right, strict=True):
            same(a, b)
    else:
        np.testing.assert_equal(left, right)


@pytest.mark.parametrize("repeats", [1, 3])
@pytest.mark.parametrize("poses", [True, False])
def test_round_trip(tmp_path, repeats, poses):
    results = [pair_set(NAMES[:2], 7, poses, repeats=repeats), PairSetResult("e", "empty", {}, (), {"sift": "why"})]
    assert not poses or np.isinf(results[0].detectors[-1].n_k).any()
    store_results(tmp_path / "results.json", results, "2026-01-02", {"cores": "2"})
    stored = load_results(tmp_path / "results.json")
    assert (stored.date, stored.machine) == ("2026-01-02", {"cores": "2"})
    for before, after in zip(results, stored.results, strict=True):
        same(before, after)


def test_no_pairs_at_all(tmp_path):
    result = pair_set(NAMES[:1], 1)
    none = pair_table(np.random.default_rng(0), 0)
    detector = replace(
        result.detectors[0],
        pairs=none,
        n_k=np.zeros((0, 2, 10)),
        rotation_error=np.zeros((0, 2, 10)),
        translation_error=np.zeros((0, 2, 10)),
        budgets={},
        calibration={},
    )
    store_results(tmp_path / "r.json", [replace(result, detectors=(detector,))])
    (after,) = load_results(tmp_path / "r.json").results
    assert after.detectors[0].n_k.shape[0] == len(after.detectors[0].pairs) == 0


def test_it_is_strict_json(tmp_path):
    store_results(tmp_path / "r.json", [pair_set(NAMES[:2], 5, poses=False)])

    def refuse(constant):
        raise AssertionError(constant)

    json.loads((tmp_path / "r.json").read_text(), parse_constant=refuse)
    assert plain([np.nan, np.inf, -np.inf, np.float32(2), True, (None,)]) == [None, "inf", "-inf", 2, True, [None]]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not JSON"),
        ("[]", "is not a 'sips_lit benchmark 1'"),
        ('{"format": "sips_lit benchmark 1", "pair_sets": [{}]}', "is damaged"),
    ],
)
def test_wrong_files(tmp_path, content, message):
    path = tmp_path / "r.json"
    path.write_text(content)
    with pytest.raises(BadInputError, match=message):
        load_results(path)
    with pytest.raises(BadInputError, match="cannot read"):
        load_results(tmp_path / "missing.json")

import dataclasses
import json

import numpy as np
import pytest
from benchmark_examples import NAMES, pair_set

from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.stored import plain, store_results


def read(path):
    """The content of a file, refusing what is no strict JSON."""

    def refuse(constant):
        raise AssertionError(constant)

    return json.loads(path.read_text(), parse_constant=refuse)


def numbers(values):
    """Nested lists with null and "inf" as an array."""
    array = np.array(values, object)
    return np.array([np.nan if v is None else float(v) for v in array.ravel()]).reshape(array.shape)


@pytest.mark.parametrize("repeats", [1, 3])
@pytest.mark.parametrize("poses", [True, False])
def test_everything_is_stored(tmp_path, repeats, poses):
    results = [pair_set(NAMES[:2], 7, poses, repeats=repeats), PairSetResult("e", "empty", {}, (), {"sift": "why"})]
    assert not poses or np.isinf(results[0].detectors[-1].n_k).any()
    store_results(tmp_path / "results.json", results, "2026-01-02", {"cores": "2"})
    stored = read(tmp_path / "results.json")
    assert (stored["date"], stored["machine"]) == ("2026-01-02", {"cores": "2"})
    assert stored["pair_sets"][1] == {
        "key": "e",
        "title": "empty",
        "protocol": {},
        "skipped": {"sift": "why"},
        "detectors": [],
    }
    for method, found in zip(results[0].detectors, stored["pair_sets"][0]["detectors"], strict=True):
        assert set(found) == {field.name for field in dataclasses.fields(method)}
        assert (found["key"], found["name"], found["ks"], found["n_max"]) == (
            method.key,
            method.name,
            list(method.ks),
            200,
        )
        for name in ("n_k", "rotation_error", "translation_error", "points0", "points1"):
            np.testing.assert_array_equal(numbers(found[name]), getattr(method, name))
        for name in ("overlap", "gap", "pixels", "rotation", "translation"):
            np.testing.assert_array_equal(numbers(found["pairs"][name]), getattr(method.pairs, name))
        assert found["pairs"]["name"] == list(method.pairs.name)
        for at, budget in zip(found["budgets"], method.budgets.values(), strict=True):
            for field in dataclasses.fields(budget):
                np.testing.assert_array_equal(numbers(at[field.name]), getattr(budget, field.name))
        for n, calibration in method.calibration.items():
            for field in dataclasses.fields(calibration):
                stored_numbers = numbers(found["calibration"][str(n)][field.name])
                np.testing.assert_array_equal(stored_numbers, getattr(calibration, field.name))
        assert (found["milliseconds"], found["defects"]) == (dict(method.milliseconds), dict(method.defects))


def test_it_is_strict_json(tmp_path):
    store_results(tmp_path / "r.json", [pair_set(NAMES[:2], 5, poses=False)])
    read(tmp_path / "r.json")
    assert plain([np.nan, np.inf, -np.inf, np.float32(2), True, (None,)]) == [None, "inf", "-inf", 2, True, [None]]

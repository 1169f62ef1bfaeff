from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from tiny_methods import MEASURES

from sips_lit.evaluate.result import PairTable, PoseOutcome

P, R, K = 6, 1, 2  # pairs, repeats of a verification that is not random, values of k
SHAPES = {
    "n_k": (P, R, K),
    "n_k_judged": (P, R, K),
    "unknown": (P,),
    "rotation_error": (P, R, K),
    "translation_error": (P, R, K),
    "points0": (P,),
    "points1": (P,),
}
SHAPES_AT_BUDGET = {
    "matches": (P,),
    "inliers": (P, R),
    "rotation_error": (P, R),
    "translation_error": (P, R),
    "outcome": (P, R),
    "repeatability": (P,),
    "matching_score": (P,),
    "spread": (P,),
}


def shapes(record) -> dict[str, tuple[int, ...]]:
    values = {name: getattr(record, name) for name in record.__dataclass_fields__}
    return {name: value.shape for name, value in values.items() if isinstance(value, np.ndarray)}


def test_shapes_are_those_of_the_docstrings(measured_flights):
    _, results = measured_flights
    for result in results:
        assert shapes(result) == SHAPES
        assert shapes(result.pairs) == {
            "overlap": (P,),
            "gap": (P,),
            "pixels": (P,),
            "rotation": (P,),
            "translation": (P,),
        }
        assert len(result.ks) == K
        assert MEASURES.n in result.budgets
        for n, at in result.budgets.items():
            assert at.n == n
            assert shapes(at) == SHAPES_AT_BUDGET


def test_a_failure_is_infinite_and_an_unknown_pose_nan(measured_flights):
    """The flights have homographies and no poses."""
    _, results = measured_flights
    for result in results:
        assert not np.isnan(result.n_k).any()
        assert (np.isinf(result.n_k) | (result.n_k <= result.n_max)).all()
        assert np.isnan(result.pairs.translation).all()
        assert np.isnan(result.translation_error).all()
        for at in result.budgets.values():
            assert (at.outcome == PoseOutcome.UNKNOWN).all()
            assert np.isnan(at.rotation_error).all()


def test_more_inliers_take_at_least_as_many_points(measured_flights):
    _, results = measured_flights
    for result in results:
        assert list(result.ks) == sorted(result.ks)
        assert (result.n_k[:, :, 0] <= result.n_k[:, :, 1]).all()
        assert (result.n_k >= np.array(result.ks)).all()  # k inliers need k points


def test_a_table_is_as_long_as_its_pairs():
    zeros = np.zeros(3)
    assert len(PairTable(("a", "b", "c"), *[zeros] * 5)) == 3
    assert len(PairTable((), *[zeros[:0]] * 5)) == 0


def test_results_are_not_changed_afterwards(measured_flights):
    _, results = measured_flights
    for record in (results[0], results[0].pairs, results[0].budgets[MEASURES.n]):
        for name in record.__dataclass_fields__:
            with pytest.raises(FrozenInstanceError):
                setattr(record, name, None)

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.detect.sanitise import Defects, sanitise
from sips_lit.errors import BadInputError
from sips_lit.types import Features, Keypoints

SHAPE = (20, 30)
NAN, INF = float("nan"), float("inf")


def points(*rows):
    """Keypoints of (x, y, score, scale)."""
    table = np.array(rows, np.float32).reshape(-1, 4)
    return Keypoints(table[:, :2], table[:, 2], table[:, 3])


def test_legal_points_pass_untouched():
    given_points = points((3, 4, 0.9, 1), (29.5, 19.5, 0.5, 2), (-0.5, -0.5, 0.1, 1))
    cleaned, defects = sanitise(given_points, SHAPE, 3)
    np.testing.assert_array_equal(cleaned.xy, given_points.xy)
    assert defects == Defects(images=1, asked=3, returned=3, kept=3)
    assert str(defects) == ""


@pytest.mark.parametrize(
    ("bad", "kind"),
    [
        ((NAN, 4, 1, 1), "invalid"),
        ((3, INF, 1, 1), "invalid"),
        ((3, 4, NAN, 1), "invalid"),
        ((3, 4, -INF, 1), "invalid"),
        ((3, 4, 1, NAN), "invalid"),
        ((3, 4, 1, 0), "invalid"),
        ((30, 4, 1, 1), "outside"),
        ((-0.6, 4, 1, 1), "outside"),
        ((4, 20, 1, 1), "outside"),
        ((4, -1, 1, 1), "outside"),
    ],
)
def test_each_illegal_point_is_dropped_and_counted_once(bad, kind):
    cleaned, defects = sanitise(points(bad, (7, 8, 0.5, 1)), SHAPE, 2)
    np.testing.assert_array_equal(cleaned.xy, [[7, 8]])
    assert getattr(defects, kind) == 1
    assert defects.returned - defects.kept == 1
    assert (defects.missing, defects.short, defects.empty) == (1, 1, 0)
    assert str(defects) != ""


def test_the_best_of_duplicates_stays():
    cleaned, defects = sanitise(points((3, 4, 0.2, 1), (5, 5, 0.5, 1), (3, 4, 0.9, 1), (3, 4, 0.9, 2)), SHAPE, 4)
    np.testing.assert_array_equal(np.column_stack([cleaned.xy, cleaned.scale]), [[3, 4, 1], [3, 4, 2], [5, 5, 1]])
    np.testing.assert_array_equal(cleaned.score, np.float32([0.9, 0.9, 0.5]))
    assert (defects.duplicates, defects.unsorted) == (1, 1)


def test_negative_zero_is_zero():
    assert sanitise(points((0.0, 4, 1, 1), (-0.0, 4, 1, 1)), SHAPE, 2)[1].duplicates == 1


def test_two_orientations_are_not_duplicates():
    features = Features(points(*[(3, 4, 1, 1)] * 3), np.array([[0, 1], [1, 0], [0, 1]], np.float32), "l2")
    cleaned, defects = sanitise(features, SHAPE, 3)
    np.testing.assert_array_equal(cleaned.descriptors, [[0, 1], [1, 0]])
    assert defects.duplicates == 1


def test_descriptors_stay_with_their_points():
    features = Features(
        points((1, 1, 0.1, 1), (2, 2, 0.3, 1), (99, 1, 0.9, 1), (3, 3, 0.2, 1)),
        np.arange(8, dtype=np.uint8).reshape(4, 2),
        "hamming",
    )
    cleaned, defects = sanitise(features, SHAPE, 2)
    np.testing.assert_array_equal(cleaned.descriptors, [[2, 3], [6, 7]])
    np.testing.assert_array_equal(cleaned.keypoints.xy, [[2, 2], [3, 3]])
    assert cleaned.norm == "hamming"
    assert (defects.outside, defects.surplus, defects.unsorted) == (1, 1, 1)


def test_a_descriptor_that_is_not_finite_is_invalid():
    features = Features(points((1, 1, 1, 1), (2, 2, 0.5, 1)), np.array([[NAN, 0], [1, 0]], np.float32), "l2")
    cleaned, defects = sanitise(features, SHAPE, 2)
    assert len(cleaned) == defects.invalid == 1


def test_covariances_stay_with_their_points_and_are_checked():
    given = points((9, 2, 0.1, 1), (5, 2, 0.9, 1), (7, 1, 0.5, 1))
    covariance = np.stack([np.eye(2) * factor for factor in (1, 2, NAN)]).astype(np.float32)
    cleaned, defects = sanitise(replace(given, covariance=covariance), SHAPE, 3)
    np.testing.assert_array_equal(cleaned.covariance, covariance[[1, 0]])
    assert defects.invalid == 1
    with pytest.raises(BadInputError, match=r"covariances of shape \(2, 2, 2\) for 3 points"):
        sanitise(replace(given, covariance=covariance[:2]), SHAPE, 3)


def test_ties_by_row_then_column():
    cleaned, defects = sanitise(points((9, 2, 1, 1), (5, 2, 1, 1), (7, 1, 1, 1)), SHAPE, 3)
    np.testing.assert_array_equal(cleaned.xy, [[7, 1], [5, 2], [9, 2]])
    assert defects.unsorted == 0


@pytest.mark.parametrize("n", [0, 5])
def test_none(n):
    cleaned, defects = sanitise(Keypoints.empty(), SHAPE, n)
    assert len(cleaned) == 0
    assert (defects.missing, defects.empty, str(defects)) == (n, int(n > 0), "")


def test_arrays_that_do_not_belong_together_are_refused():
    with pytest.raises(BadInputError, match=r"\(1,\)"):
        sanitise(Keypoints(np.zeros((2, 2), np.float32), np.zeros(1, np.float32), np.ones(2, np.float32)), SHAPE, 2)
    with pytest.raises(BadInputError, match=r"\(3, 4\)"):
        sanitise(Features(points((1, 1, 1, 1)), np.zeros((3, 4)), "l2"), SHAPE, 2)


value = st.sampled_from([-1.0, -0.5, 0.0, 1.5, 7.0, 19.5, 20.0, 29.5, 31.0, NAN, INF])


@settings(max_examples=80, deadline=None)
@given(rows=st.lists(st.tuples(value, value, value, value), max_size=12), n=st.integers(-1, 14))
def test_against_a_slow_twin(rows, n):
    cleaned, defects = sanitise(points(*rows), SHAPE, n)
    finite = [r for r in rows if all(np.isfinite(r)) and r[3] > 0]
    inside = [r for r in finite if -0.5 <= r[0] <= 29.5 and -0.5 <= r[1] <= 19.5]
    unique: list[tuple[float, ...]] = []
    for row in sorted(inside, key=lambda r: (-r[2], r[1], r[0])):
        if all((row[0], row[1], row[3]) != (u[0], u[1], u[3]) for u in unique):
            unique.append(row)
    expected = np.array(unique[: max(n, 0)], np.float32).reshape(-1, 4)
    np.testing.assert_array_equal(np.column_stack([cleaned.xy, cleaned.score, cleaned.scale]), expected)
    again, twice = sanitise(cleaned, SHAPE, n)
    assert str(twice) == ""
    np.testing.assert_array_equal(again.xy, cleaned.xy)
    dropped = defects.invalid + defects.outside + defects.duplicates + defects.surplus
    assert defects.returned == len(rows) == dropped + defects.kept
    assert defects.kept + defects.missing == defects.asked


def test_sums():
    one, two = sanitise(points((1, 1, 1, 1)), SHAPE, 2)[1], sanitise(points((1, NAN, 1, 1)), SHAPE, 3)[1]
    total = sum([one, two], Defects())
    assert (total.images, total.asked, total.kept, total.invalid, total.short, total.empty) == (2, 5, 1, 1, 2, 1)

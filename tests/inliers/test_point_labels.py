import numpy as np
import pytest

from sips_lit.inliers.point_labels import point_labels
from sips_lit.types import Inliers, Matches, Reason


def answer(*reasons: Reason) -> Inliers:
    """An inlier check's answer, of which only the matches' part is read."""
    values, none = np.array(reasons, np.uint8), np.zeros(0, bool)
    return Inliers(values == Reason.INLIER, values, none, none)


def test_point_labels_one_by_one():
    reasons = np.array([Reason.INLIER, Reason.FAR, Reason.UNKNOWN, Reason.LOST], np.uint8)
    matches = Matches(np.array([5, 0, 3, 1]), np.array([0, 1, 2, 3]))
    known = np.array([True, True, False, True, True, False, True])
    labels = point_labels(Inliers(reasons == 0, reasons, known, known), matches.index0, known)
    expected = [
        Reason.FAR,
        Reason.LOST,
        Reason.UNKNOWN,
        Reason.UNKNOWN,
        Reason.UNMATCHED,
        Reason.INLIER,
        Reason.UNMATCHED,
    ]
    assert labels.reason.tolist() == expected
    assert labels.inlier.tolist() == [reason == Reason.INLIER for reason in expected]
    assert labels.known.tolist() == [reason != Reason.UNKNOWN for reason in expected]


def test_the_index_of_each_image_names_its_own_points():
    matches = Matches(np.array([2]), np.array([0]))
    known = np.ones(3, bool)
    inliers = answer(Reason.INLIER)
    assert point_labels(inliers, matches.index0, known).inlier.tolist() == [False, False, True]
    assert point_labels(inliers, matches.index1, known).inlier.tolist() == [True, False, False]


@pytest.mark.parametrize(("known", "reason"), [(True, Reason.UNMATCHED), (False, Reason.UNKNOWN)])
def test_without_matches_points_are_outliers_or_unknown(known, reason):
    labels = point_labels(answer(), np.zeros(0, np.int64), np.full(3, known))
    assert labels.reason.tolist() == [reason] * 3
    assert labels.reason.dtype == np.uint8
    assert not labels.inlier.any()
    assert labels.known.tolist() == [known] * 3


def test_no_points():
    labels = point_labels(answer(), np.zeros(0, np.int64), np.zeros(0, bool))
    assert len(labels.inlier) == len(labels.known) == len(labels.reason) == 0


def test_inputs_stay_as_they_are():
    known, inliers = np.array([True, False]), answer(Reason.FAR)
    point_labels(inliers, np.array([1]), known)
    assert known.tolist() == [True, False]
    assert inliers.reason.tolist() == [Reason.FAR]

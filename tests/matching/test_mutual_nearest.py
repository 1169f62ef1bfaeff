import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sips_lit.matching.mutual_nearest import (
    FOREVER,
    MutualLifetimes,
    distances,
    mutual_nearest,
    mutual_nearest_lifetimes,
)
from sips_lit.types import Features, Keypoints, Norm

TIED = st.tuples(st.integers(0, 9), st.integers(0, 9)).flatmap(
    lambda shape: hnp.arrays(np.float32, shape, elements=st.integers(0, 5).map(float))
)


def features(descriptors: np.ndarray, norm: Norm) -> Features:
    n = len(descriptors)
    ones = np.ones(n, np.float32)
    return Features(Keypoints(np.zeros((n, 2), np.float32), ones, ones), descriptors, norm)


def obvious_mutual(matrix: np.ndarray) -> list[tuple[int, int]]:
    if 0 in matrix.shape:
        return []
    pairs = []
    for i, row in enumerate(matrix):
        j = int(np.argmin(row))
        if int(np.argmin(matrix[:, j])) == i:
            pairs.append((i, j))
    return pairs


def pairs_of(matches) -> list[tuple[int, int]]:
    return list(zip(matches.index0.tolist(), matches.index1.tolist(), strict=True))


def test_squared_l2_equals_the_loop():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(7, 16)).astype(np.float32), rng.normal(size=(5, 16)).astype(np.float32)
    expected = [[np.sum((x.astype(np.float64) - y) ** 2) for y in b] for x in a]
    np.testing.assert_allclose(distances(features(a, "l2"), features(b, "l2")), expected, rtol=1e-5)


def test_equal_descriptors_are_never_at_a_negative_distance():
    a = np.random.default_rng(1).random((50, 128), np.float32)
    result = distances(features(a, "l2"), features(a, "l2"))
    assert result.dtype == np.float32
    assert result.min() >= 0
    np.testing.assert_allclose(result.diagonal(), 0, atol=1e-3)


def test_hamming_is_exact_as_opencv_counts_it():
    rng = np.random.default_rng(2)
    a, b = (rng.integers(0, 256, (n, 32), dtype=np.uint8) for n in (6, 9))
    expected = [[cv2.norm(x[None], y[None], cv2.NORM_HAMMING) for y in b] for x in a]
    np.testing.assert_array_equal(distances(features(a, "hamming"), features(b, "hamming")), expected)


def test_norms_and_lengths_must_agree():
    a, b = features(np.zeros((2, 32), np.float32), "l2"), features(np.zeros((2, 32), np.uint8), "hamming")
    with pytest.raises(ValueError, match="l2 and hamming"):
        distances(a, b)
    with pytest.raises(ValueError, match="32 and 64"):
        distances(a, features(np.zeros((2, 64), np.float32), "l2"))


@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (3, 0)])
def test_no_points_no_matches(shape):
    empty = distances(
        features(np.zeros((shape[0], 8), np.float32), "l2"), features(np.zeros((shape[1], 8), np.float32), "l2")
    )
    assert empty.shape == shape
    assert len(mutual_nearest(empty)) == 0
    lifetimes = mutual_nearest_lifetimes(empty)
    assert len(lifetimes.matches) == 0
    assert len(lifetimes.at(5)) == 0


@given(TIED)
@settings(max_examples=100, deadline=None)
def test_mutual_nearest_equals_the_loop(matrix):
    assert pairs_of(mutual_nearest(matrix)) == obvious_mutual(matrix)


@given(TIED)
@settings(max_examples=300, deadline=None)
def test_lifetimes_are_the_matches_of_every_crop(matrix):
    lifetimes = mutual_nearest_lifetimes(matrix)
    for n in range(max(matrix.shape) + 3):
        assert pairs_of(lifetimes.at(n)) == obvious_mutual(matrix[:n, :n]), n
    assert len(set(pairs_of(lifetimes.matches))) == len(lifetimes.matches)
    assert len(lifetimes.matches) <= 2 * max(matrix.shape)


@given(TIED)
@settings(deadline=None)
def test_matches_of_all_points_live_as_those_of_every_crop_that_none_breaks(matrix):
    every = mutual_nearest_lifetimes(matrix)
    unbroken = every[every.last == FOREVER]
    unbroken = unbroken[np.argsort(unbroken.index0)]
    whole = MutualLifetimes.of_all(mutual_nearest(matrix))
    for name in ("index0", "index1", "first", "last"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(unbroken, name), name)


@pytest.mark.parametrize("shape", [(60, 60), (60, 35), (20, 60)])
def test_lifetimes_without_ties(shape):
    matrix = np.random.default_rng(3).random(shape, np.float32)
    lifetimes = mutual_nearest_lifetimes(matrix)
    for n in range(max(shape) + 1):
        assert pairs_of(lifetimes.at(n)) == obvious_mutual(matrix[:n, :n]), n


def test_a_nearer_newcomer_ends_a_match_and_an_equal_one_does_not():
    matrix = np.array([[5, 5, 4], [9, 9, 9], [9, 9, 9]], np.float32)
    lifetimes = mutual_nearest_lifetimes(matrix)
    spans = {
        pair: (int(first), int(last))
        for pair, first, last in zip(pairs_of(lifetimes.matches), lifetimes.first, lifetimes.last, strict=True)
    }
    assert spans[0, 0] == (1, 2)
    assert spans[0, 2] == (3, FOREVER)

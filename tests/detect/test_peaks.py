import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from sips_lit.detect.peaks import _maxima_on_device, local_maxima, quadratic_offsets


def window(scores: np.ndarray, row: int, column: int, radius: int) -> list[tuple[int, int]]:
    return [
        (r, c)
        for r in range(max(0, row - radius), min(scores.shape[0], row + radius + 1))
        for c in range(max(0, column - radius), min(scores.shape[1], column + radius + 1))
    ]


def brute_force(scores: np.ndarray, radius: int) -> list[tuple[int, int]]:
    """The definition, pixel by pixel."""

    def unsurpassed(row: int, column: int) -> bool:
        own = scores[row, column]
        return own > -math.inf and not any(scores[place] > own for place in window(scores, row, column, radius))

    kept = []
    for row, column in np.ndindex(scores.shape):
        earlier_equals = [
            place
            for place in window(scores, row, column, radius)
            if scores[place] == scores[row, column] and place < (row, column) and unsurpassed(*place)
        ]
        if unsurpassed(row, column) and not earlier_equals:
            kept.append((row, column))
    return sorted(kept, key=lambda place: (-scores[place], place))


def found(scores: np.ndarray, radius: int) -> list[tuple[int, int]]:
    rows, columns = local_maxima(torch.from_numpy(np.ascontiguousarray(scores)), radius)
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


FEW_VALUES = st.sampled_from([0.0, 1.0, 2.0, 3.0, -1.0, -0.0, math.nan, -math.inf, math.inf])
FEW_HIGH = st.sampled_from([0.0, 0.0, 0.0, 5.0])


@given(
    st.one_of(
        arrays(np.float32, array_shapes(min_dims=2, max_dims=2, max_side=9), elements=FEW_VALUES),
        arrays(np.float32, array_shapes(min_dims=2, max_dims=2, max_side=9), elements=FEW_HIGH),
        arrays(np.float32, array_shapes(min_dims=2, max_dims=2, max_side=9), elements=st.floats(-9, 9, width=16)),
    ),
    st.integers(0, 4),
)
@settings(max_examples=150, deadline=None)
def test_as_defined_pixel_by_pixel(scores, radius):
    kept = found(scores, radius)
    assert kept == brute_force(scores, radius)
    for i, a in enumerate(kept):
        assert all(max(abs(a[0] - b[0]), abs(a[1] - b[1])) > radius for b in kept[:i])


def on_device(scores: np.ndarray, radius: int) -> list[tuple[int, int]]:
    """What a GPU does, here on the CPU."""
    places = _maxima_on_device(torch.from_numpy(scores), radius).tolist()
    return [divmod(place, scores.shape[1]) for place in places]


@given(
    st.one_of(
        arrays(np.float32, array_shapes(min_dims=2, max_dims=2, max_side=12), elements=FEW_VALUES),
        arrays(np.float32, array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.floats(-9, 9, width=16)),
    ),
    st.integers(0, 6),
)
@settings(max_examples=100, deadline=None)
def test_the_same_on_every_device(scores, radius):
    assert found(scores, radius) == on_device(scores, radius)


@pytest.mark.parametrize("levels", [3, 40, 10**6])
def test_the_same_on_every_device_of_a_large_map(levels):
    scores = np.random.default_rng(levels).integers(0, levels, (240, 321)).astype(np.float32)
    assert found(scores, 5) == on_device(scores, 5)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float64])
def test_other_types_of_numbers(dtype):
    scores = torch.from_numpy(np.random.default_rng(0).permutation(12 * 17).reshape(12, 17)).to(dtype).T
    rows, columns = local_maxima(scores, 2)
    assert list(zip(rows.tolist(), columns.tolist(), strict=True)) == brute_force(scores.double().numpy(), 2)


@pytest.mark.parametrize("radius", [0, 1, 5, 8])
def test_large_random_map(radius):
    scores = np.random.default_rng(radius).standard_normal((40, 53)).astype(np.float32)
    assert found(scores, radius) == brute_force(scores, radius)


def test_a_pixel_surpassed_elsewhere_does_not_suppress_its_equals():
    scores = np.array([[3.0, 2, 2]], np.float32)  # the middle one falls to the 3, the right one is beside an equal only
    assert found(scores, 1) == [(0, 0), (0, 2)]


@pytest.mark.parametrize("radius", [1, 4])
def test_of_a_constant_map_only_the_first_pixel_is_kept(radius):
    assert found(np.full((7, 6), 0.25, np.float32), radius) == [(0, 0)]


def test_radius_zero_keeps_every_pixel_in_order():
    assert found(np.array([[1.0, 2], [2, 3]], np.float32), 0) == [(1, 1), (0, 1), (1, 0), (0, 0)]


@pytest.mark.parametrize(("value", "kept"), [(0.3, [(0, 0)]), (math.nan, []), (-math.inf, []), (math.inf, [(0, 0)])])
def test_a_single_pixel(value, kept):
    assert found(np.array([[value]], np.float32), 5) == kept


def test_a_neighbour_at_the_radius_is_suppressed_and_one_beyond_is_not():
    scores = np.zeros((1, 12), np.float32)
    scores[0, [2, 7]] = [2, 1]
    assert (0, 7) not in found(scores, 5)
    assert found(scores, 4)[:2] == [(0, 2), (0, 7)]


@pytest.mark.slow
@pytest.mark.parametrize("first", [2**24, 2**24 + 1])
def test_ties_beyond_the_integers_of_single_precision(first):
    """Pixels number 2^24 and 2^24 + 1 in raster order float32 does not tell apart, and 2^24 + 1 it does not know."""
    scores = torch.full((1, 2**24 + 4), -torch.inf)
    scores[0, first : first + 2] = 1
    rows, columns = local_maxima(scores, 1)
    assert (rows.tolist(), columns.tolist()) == ([0], [first])


def offset(scores: np.ndarray, row: int, column: int) -> list[float]:
    at = (np.array([row]), np.array([column]))
    return quadratic_offsets(torch.from_numpy(np.asarray(scores)), *at)[0].tolist()


@given(st.floats(-0.49, 0.49), st.floats(-0.49, 0.49), st.floats(0.2, 3), st.floats(0.2, 3), st.floats(-0.9, 0.9))
@settings(max_examples=60, deadline=None)
def test_exact_on_quadratics(x, y, a, b, mixing):
    c = mixing * np.sqrt(a * b)  # |c| < sqrt(a b): negative definite
    dy, dx = np.mgrid[0:7, 0:7] - 3.0
    dx, dy = dx - x, dy - y
    scores = -(a * dx**2 + 2 * c * dx * dy + b * dy**2)
    np.testing.assert_allclose(offset(scores, 3, 3), [x, y], atol=1e-8)


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.3, -0.2), (-0.45, 0.45), (0.12, 0.4)])
@pytest.mark.parametrize("sigma", [1.5, 2.0, 3.0])
def test_centre_of_a_gaussian_blob(x, y, sigma):
    rows, columns = np.mgrid[0:21, 0:21]
    blob = np.exp(-((columns - 10 - x) ** 2 + (rows - 10 - y) ** 2) / (2 * sigma**2)).astype(np.float32)
    row, column = local_maxima(torch.from_numpy(blob), 5)
    np.testing.assert_allclose(offset(blob, int(row[0]), int(column[0])), [x, y], atol=0.05)


def test_steps_are_cut_to_half_a_pixel():
    dy, dx = np.mgrid[-1:2, -1:2].astype(float)
    scores = -((dx - 2) ** 2) - (dy + 0.2) ** 2
    np.testing.assert_allclose(offset(scores, 1, 1), [0.5, -0.2], atol=1e-9)


def test_no_step_without_a_proper_top():
    dy, dx = np.mgrid[-1:2, -1:2].astype(float)
    saddle, valley, ridge = dx**2 - dy**2 + 0.1 * dx, dx**2 + dy**2 + 0.1 * dx, -(dx**2) + 0.1 * dx
    for scores in (np.zeros((3, 3)), saddle, saddle.T, valley, ridge, ridge.T):
        assert offset(scores, 1, 1) == [0, 0]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_no_step_beside_a_value_that_is_not_finite(bad):
    dy, dx = np.mgrid[-1:2, -1:2].astype(float)
    scores = -((dx - 0.2) ** 2) - dy**2
    assert offset(scores, 1, 1)[0] == pytest.approx(0.2)
    scores[0, 0] = bad
    assert offset(scores, 1, 1) == [0, 0]


def test_no_step_at_the_border():
    rows, columns = np.mgrid[0:5, 0:6].astype(float)
    scores = -((columns - 2.2) ** 2) - (rows - 2.3) ** 2
    border = [(r, c) for r in range(5) for c in range(6) if r in (0, 4) or c in (0, 5)]
    assert all(offset(scores, r, c) == [0, 0] for r, c in border)
    assert offset(scores, 2, 2) == pytest.approx([0.2, 0.3])


@pytest.mark.parametrize("shape", [(1, 1), (2, 9), (9, 2)])
def test_maps_too_small_for_a_fit(shape):
    assert offset(np.random.default_rng(0).random(shape), 0, 1 % shape[1]) == [0, 0]


def test_no_points():
    none = np.zeros(0, np.int64)
    assert quadratic_offsets(torch.zeros(5, 5), none, none).shape == (0, 2)

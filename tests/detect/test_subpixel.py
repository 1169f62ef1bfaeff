import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.detect.nms import local_maxima
from sips_lit.detect.subpixel import quadratic_offsets


def offset(scores: np.ndarray, row: int, column: int) -> list[float]:
    at = (torch.tensor([row]), torch.tensor([column]))
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
    none = torch.zeros(0, dtype=torch.long)
    assert quadratic_offsets(torch.zeros(5, 5), none, none).shape == (0, 2)

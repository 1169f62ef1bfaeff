import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.detect.peaks import local_maxima, quadratic_offsets
from sips_lit.export.peak_steps import best_pixels, fitted_offsets, peak_pixels


def slow_peaks(scores: np.ndarray, radius: int) -> list[tuple[int, int]]:
    """Pixel by pixel: no better one within the radius, and of equal maxima the first in raster order."""
    height, width = scores.shape
    maxima = np.zeros_like(scores, bool)
    for y, x in np.ndindex(height, width):
        window = scores[max(0, y - radius) : y + radius + 1, max(0, x - radius) : x + radius + 1]
        maxima[y, x] = scores[y, x] >= window.max()
    kept = [
        (y, x)
        for y, x in zip(*np.nonzero(maxima), strict=True)
        if not any(
            maxima[v, u]
            for v in range(max(0, y - radius), y + 1)
            for u in range(max(0, x - radius), min(width, x + radius + 1))
            if (v, u) < (y, x)
        )
    ]
    return sorted(kept, key=lambda place: (-scores[place], *place))


@settings(max_examples=60, deadline=None)
@given(
    st.integers(1, 13),
    st.integers(1, 14),
    st.integers(0, 4),
    st.integers(1, 30),
    st.integers(2, 40),
    st.integers(0, 99),
    st.integers(0, 3),
)
def test_points_are_those_of_a_slow_search(height, width, radius, n, values, seed, border):
    """With few values there are many ties; images are too small for a border, so a sixteenth of them has none."""
    scores = np.random.default_rng(seed).integers(-values, 0, (2, height, width)).astype(np.float32)
    maps = torch.from_numpy(scores)
    value, rows, columns = best_pixels(maps, peak_pixels(maps, radius), n, border)
    assert value.shape == rows.shape == columns.shape == (2, n)
    for index in range(2):
        expected = slow_peaks(scores[index], radius)
        found = int((value[index] > -torch.inf).sum())
        assert found == min(n, len(expected))
        assert list(zip(rows[index, :found].tolist(), columns[index, :found].tolist(), strict=True)) == expected[:n]
        np.testing.assert_array_equal(value[index, :found], [scores[index][place] for place in expected[:n]])
        assert bool((rows[index] < height).all()), "what is left points into the image"
        assert bool((columns[index] < width).all())


@pytest.mark.parametrize("size", [(40, 52), (1, 9), (2, 2), (3, 3)])
def test_offsets_are_those_of_the_detector(size):
    scores = torch.randn(3, *size, generator=torch.Generator().manual_seed(0))
    scores[2] = scores[2].round()  # flat places have no proper top
    value, rows, columns = best_pixels(scores, peak_pixels(scores, 2), 200)
    offsets = fitted_offsets(scores, rows, columns)
    for index in range(3):
        at = local_maxima(scores[index], 2)
        count = min(200, len(at[0]))
        assert int((value[index] > -torch.inf).sum()) == count
        expected = quadratic_offsets(scores[index], at[0], at[1])[:count].astype(np.float32)
        np.testing.assert_array_equal(offsets[index, :count], expected)
    assert size[0] < 3 or bool((offsets != 0).any())


def test_what_is_not_a_number_is_no_peak():
    scores = torch.full((1, 20, 20), torch.nan)
    assert not bool((best_pixels(scores, peak_pixels(scores, 3), 4)[0] > -torch.inf).any())


@pytest.mark.parametrize(("border", "margin"), [(0, 0), (1, 1), (2, 2), (3, 2)])
def test_a_border_without_points_is_a_sixteenth_of_the_shorter_side_at_most(border, margin):
    """As in `PointSelector`: peaks are suppressed by better ones in the border all the same."""
    scores = np.random.default_rng(0).normal(size=(1, 33, 70)).astype(np.float32)
    maps = torch.from_numpy(scores)
    value, rows, columns = best_pixels(maps, peak_pixels(maps, 2), 500, border)
    found = (value[0] > -torch.inf).tolist()
    expected = [(y, x) for y, x in slow_peaks(scores[0], 2) if margin <= y < 33 - margin and margin <= x < 70 - margin]
    assert list(zip(rows[0, found].tolist(), columns[0, found].tolist(), strict=True)) == expected

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.baselines.controls import GridPoints, RandomPoints

BLACK = np.zeros((120, 200), np.uint8)


def test_random_points_depend_on_seed_and_image():
    here = RandomPoints().detect(BLACK, 20).xy
    other_image = BLACK.copy()
    other_image[5, 5] = 1
    assert not np.array_equal(here, RandomPoints(seed=1).detect(BLACK, 20).xy)
    assert not np.array_equal(here, RandomPoints().detect(other_image, 20).xy)


def test_random_points_are_uniform():
    xy = RandomPoints().detect(BLACK, 20_000).xy
    counts = np.histogram2d(xy[:, 0], xy[:, 1], bins=(4, 4), range=[(0, 199), (0, 119)])[0]
    np.testing.assert_allclose(counts, 20_000 / 16, rtol=0.12)


@settings(max_examples=40, deadline=None)
@given(n=st.integers(1, 400), height=st.integers(1, 300), width=st.integers(1, 300))
def test_grid_gives_n_different_points_inside(n, height, width):
    xy = GridPoints().detect(np.zeros((height, width), np.uint8), n).xy
    assert len(np.unique(xy, axis=0)) == n
    assert ((xy > -0.5) & (xy < (width - 0.5, height - 0.5))).all()


def test_grid_is_regular():
    xy = GridPoints().detect(BLACK, 60).xy  # 10 x 6 cells of 20 px
    np.testing.assert_allclose(np.unique(xy[:, 0]), np.arange(10) * 20 + 9.5)
    np.testing.assert_allclose(np.unique(xy[:, 1]), np.arange(6) * 20 + 9.5)


def test_the_first_of_the_grid_are_spread():
    first = GridPoints().detect(BLACK, 60).xy[:20]
    assert {(x > 99.5, y > 59.5) for x, y in first} == {(a, b) for a in (False, True) for b in (False, True)}


@pytest.mark.parametrize("kind", [RandomPoints, GridPoints])
def test_scores_strictly_order_the_points(kind):
    assert (np.diff(kind().detect(BLACK, 500).score) < 0).all()

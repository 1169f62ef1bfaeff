import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.metrics.spread import spread


def test_counted_by_hand():
    size = (80, 40)  # cells of 10 x 5 pixels
    assert spread(np.zeros((0, 2)), size) == 0
    assert spread(np.array([[3, 3]]), size) == 1 / 64
    assert spread(np.array([[3, 3], [9.4, 4.4]]), size) == 1 / 64
    assert spread(np.array([[3, 3], [9.6, 3]]), size) == 2 / 64
    assert spread(np.array([[-0.5, -0.5], [79.5, 39.5], [79, 39]]), size) == 2 / 64
    assert spread(np.array([[0, 0], [79, 39]]), size, cells=1) == 1


def test_a_full_grid():
    x, y = np.meshgrid(np.arange(80), np.arange(40))
    assert spread(np.column_stack([x.ravel(), y.ravel()]), (80, 40)) == 1


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 63), st.integers(0, 31)), max_size=20))
def test_the_slow_twin(xy):
    cells = {(x // 8, y // 4) for x, y in xy}
    assert spread(np.array(xy, float).reshape(-1, 2), (64, 32)) == pytest.approx(len(cells) / 64)

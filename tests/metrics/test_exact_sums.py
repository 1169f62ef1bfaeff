from itertools import permutations

import numpy as np
import pytest
import torch

from sips_lit.metrics.exact_sums import ExactSums


class Total(ExactSums[np.ndarray]):
    """Sums of two numbers, to an eighth."""

    units = 8
    scalars = ("size",)

    def __init__(self) -> None:
        super().__init__(2)

    def update(self, numbers) -> None:
        self._add(np.asarray(numbers, np.float64))

    def summarised(self, sums):
        return sums


def test_the_sum_is_the_same_in_every_order_where_floats_have_another():
    parts = [[2.0**24, 0.125], [1.0, 0.25], [-(2.0**24), 3.0], [1.0, -1.5]]
    assert np.float32(2.0**24) + np.float32(1) == np.float32(2.0**24)  # what a float32 would lose
    for order in permutations(parts):
        total = Total()
        for part in order:
            total.update(part)
        np.testing.assert_array_equal(total.result(), [2.0, 1.875])


def test_numbers_are_rounded_to_the_units():
    total = Total()
    total.update([0.2, -0.2])  # 1.6 eighths
    np.testing.assert_array_equal(total.result(), [0.25, -0.25])


def test_scalars_are_float32_of_the_summary():
    total = Total()
    total.update([1.5, 0])
    (computed,) = total.compute().values()
    assert computed.dtype == torch.float32
    assert float(computed) == pytest.approx(total.result().size)

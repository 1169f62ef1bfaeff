import numpy as np
import pytest

from sips_lit.errors import BadInputError
from sips_lit.frames.span import FULL, Span, find_span


def images(low: int, high: int, count: int = 40, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(low, high + 1, (count, 60, 80)).astype(np.uint16)


def found(stack: np.ndarray) -> Span:
    return find_span(len(stack), lambda index: stack[index])


@pytest.mark.parametrize(("low", "high"), [(28900, 29920), (0, 1023), (300, 3900), (50000, 65000)])
def test_a_part_of_the_range_is_spread(low: int, high: int):
    span = found(images(low, high))
    width = high - low
    assert low - 0.15 * width <= span.low <= low
    assert high <= span.high <= high + 0.15 * width
    grey = span(images(low, high, 1, 1))
    assert grey.min() < 30
    assert grey.max() > 225


def test_the_full_range_is_kept():
    values = np.arange(65536, dtype=np.uint16).reshape(1, 256, 256)
    assert found(values) == FULL
    np.testing.assert_array_equal(FULL(values[0]), (values[0] / 257 + 0.5).astype(np.uint8))
    assert found(images(10000, 60000)) == FULL


def test_values_outside_are_clipped():
    np.testing.assert_array_equal(Span(100, 200)(np.array([0, 100, 150, 200, 65535], np.uint16)), [0, 0, 128, 255, 255])


def test_dead_and_hot_pixels_do_not_count():
    stack = images(28900, 29920)
    stack[:, 0, 0], stack[:, 0, 1] = 0, 65535
    assert found(stack).high < 31000


def test_eight_bits_flat_and_unreadable_images():
    assert found(np.zeros((3, 4, 4), np.uint8)) == FULL
    assert found(np.full((3, 4, 4), 700, np.uint16)) == FULL

    def read(index: int) -> np.ndarray:
        if index == 0:
            raise BadInputError("damaged")
        return images(28900, 29920)[index]

    assert find_span(40, read).low < 28900
    assert find_span(1, read) == FULL


def test_one_span_by_a_sample_of_all():
    """The first images are dark, the last ones bright: the span covers both."""
    stack = np.concatenate([images(1000, 1100, 20), images(3000, 3100, 20)])
    span = found(stack)
    assert span.low <= 1000
    assert span.high >= 3100

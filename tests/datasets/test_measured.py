import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.datasets.measured import nearest_in_time

TIMES = st.lists(st.integers(0, 60), max_size=8)
OTHERS = st.lists(st.integers(0, 60), min_size=1, max_size=8)


def check(times, others, tolerance, nearest):
    assert nearest.shape == (len(times),)
    for time, index in zip(times, nearest, strict=True):
        smallest = min(abs(time - other) for other in others)
        if smallest > tolerance:
            assert index == -1
        else:
            assert abs(time - others[index]) == smallest


@given(TIMES, OTHERS, st.integers(0, 12))
@settings(max_examples=100, deadline=None)
def test_seconds_as_the_slow_twin(times, others, tolerance):
    at, there = (1305031102.0 + np.array(values, float) / 100 for values in (times, others))
    check(times, others, tolerance, nearest_in_time(at, there, tolerance / 100 + 1e-6))


@given(TIMES, OTHERS, st.integers(0, 12))
@settings(max_examples=100, deadline=None)
def test_nanoseconds_as_the_slow_twin(times, others, tolerance):
    # a double could not tell these apart
    at, there = (1403715273262142976 + np.array(values, np.int64) for values in (times, others))
    check(times, others, tolerance, nearest_in_time(at, there, tolerance))

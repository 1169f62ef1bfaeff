"""Homographies and points for tests that try many."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

SMALL = st.floats(-0.3, 0.3)
homographies = st.builds(
    lambda a, tx, ty, px, py, sign: (
        sign * (np.array([[1 + a[0], a[1], tx], [a[2], 1 + a[3], ty], [px * 1e-3, py * 1e-3, 1]]))
    ),
    arrays(float, 4, elements=SMALL),
    st.floats(-50, 50),
    st.floats(-50, 50),
    SMALL,
    SMALL,
    st.sampled_from([1.0, -2.5]),
)
points = arrays(float, (7, 2), elements=st.floats(0, 200))

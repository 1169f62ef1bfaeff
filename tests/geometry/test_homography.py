import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sips_lit.geometry.homography import apply_homography

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


@given(homographies, points)
@settings(max_examples=60, deadline=None)
def test_there_and_back(H, xy):
    there = apply_homography(H, xy)
    assert np.isfinite(there).all()
    np.testing.assert_allclose(apply_homography(np.linalg.inv(H), there), xy, atol=1e-6)


@given(homographies, points)
@settings(max_examples=40, deadline=None)
def test_as_opencv(H, xy):
    expected = cv2.perspectiveTransform(xy[:, None], H)[:, 0]
    np.testing.assert_allclose(apply_homography(H, xy), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("sign", [1, -1, 0.1])
def test_points_beyond_the_horizon_are_nan(sign):
    H = sign * np.array([[1, 0, 0], [0, 1, 0], [-0.01, 0, 1]])
    mapped = apply_homography(H, np.array([[50.0, 10], [100, 10], [150, 10]]))
    np.testing.assert_allclose(mapped[0], [100, 20])
    assert np.isnan(mapped[1:]).all()


def test_no_points():
    assert apply_homography(np.eye(3), np.zeros((0, 2))).shape == (0, 2)

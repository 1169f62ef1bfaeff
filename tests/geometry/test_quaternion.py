import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.geometry.quaternion import to_rotation


@given(st.tuples(*[st.floats(-1, 1)] * 3), st.floats(-np.pi, np.pi), st.floats(0.1, 9))
@settings(max_examples=60, deadline=None)
def test_as_axis_and_angle(direction, angle, length):
    axis = np.add(direction, (0, 0, 2))  # never of length 0
    axis /= np.linalg.norm(axis)
    quaternion = length * np.append(axis * np.sin(angle / 2), np.cos(angle / 2))
    np.testing.assert_allclose(to_rotation(quaternion[None])[0], cv2.Rodrigues(axis * angle)[0], atol=1e-12)


def test_many_at_once():
    half = np.sqrt(0.5)
    turns = to_rotation(np.array([[0, 0, 0, 1], [0, 0, half, half], [1, 0, 0, 0]]))
    expected = [np.eye(3), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], np.diag([1, -1, -1])]
    np.testing.assert_allclose(turns, expected, atol=1e-12)


def test_none_of_length_zero():
    assert to_rotation(np.zeros((0, 4))).shape == (0, 3, 3)
    assert np.isnan(to_rotation(np.zeros((1, 4)))).all()


@pytest.mark.parametrize("sign", [1, -1])
def test_both_signs_are_the_same_rotation(sign):
    q = np.array([[0.1, 0.2, 0.3, 0.9]])
    np.testing.assert_allclose(to_rotation(sign * q), to_rotation(q))

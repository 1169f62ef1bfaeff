import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.geometry.pose import PoseEstimate, rotation_error, to_quaternion, to_rotation, translation_error


def turned(vector: np.ndarray, translation: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.asarray(vector, np.float64))[0]
    T[:3, 3] = translation
    return T


@pytest.mark.parametrize("degrees", [0, 1e-6, 1e-3, 0.5, 45, 90, 179.999, 180])
def test_the_angle_between_two_turns(degrees):
    axis = np.array([2, -1, 2]) / 3
    start = np.array([0.3, 1.1, -0.4])
    turn = turned(np.radians(degrees) * axis)
    assert rotation_error(turned(start) @ turn, turned(start)) == pytest.approx(degrees, rel=1e-9, abs=1e-9)


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_symmetric_and_zero_only_for_equal_ones(seed):
    generator = np.random.default_rng(seed)
    a, b = (turned(generator.normal(size=3), tuple(generator.normal(size=3))) for _ in range(2))
    assert rotation_error(a, b) == pytest.approx(rotation_error(b, a), abs=1e-9)
    assert translation_error(a, b) == translation_error(b, a) > 0
    assert rotation_error(a, a) < 1e-9
    expected = np.degrees(np.linalg.norm(cv2.Rodrigues(a[:3, :3].T @ b[:3, :3])[0]))
    assert rotation_error(a, b) == pytest.approx(expected, abs=1e-6)


def test_translation_is_euclidean_and_does_not_see_turns():
    assert translation_error(turned([0, 0, 1], (1, 2, 3)), turned([0, 1, 0], (1, 5, 7))) == 5


def test_inliers_are_those_that_agree():
    assert PoseEstimate(None, np.array([True, False, True, False, False])).inliers == 2


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


@given(st.integers(0, 10_000), st.sampled_from([0.0, 1e-9, 0.4, 3.0, np.pi - 1e-9, np.pi]))
@settings(max_examples=40, deadline=None)
def test_a_quaternion_of_a_rotation_leads_back_to_it(seed, angle):
    axis = np.random.default_rng(seed).normal(size=3)
    R = turned(angle * axis / np.linalg.norm(axis))[:3, :3]
    q = to_quaternion(R[None])
    np.testing.assert_allclose(to_rotation(q)[0], R, atol=1e-9)
    assert np.linalg.norm(q) == pytest.approx(1)
    assert q[0, 3] == pytest.approx(np.cos(angle / 2), abs=1e-7)  # the real part comes last

import numpy as np
import pytest
from textured_scenes import texture

from sips_lit.geometry.remembered_stereo import RememberingMatcher, remembering
from sips_lit.geometry.stereo import StereoMatcher

WIDE = texture(60, 150)
LEFT, RIGHT = WIDE[:, 12:112].copy(), WIDE[:, 22:122].copy()  # disparity 10
XY = np.array([[50, 20], [70, 40.5], [2, 2]], np.float32)


@pytest.fixture
def asked(monkeypatch):
    """How often a disparity was really looked for."""
    calls, real = [], StereoMatcher.disparity
    monkeypatch.setattr(StereoMatcher, "disparity", lambda *a, **k: calls.append(1) or real(*a, **k))
    return calls


def test_the_same_question_is_answered_once_and_as_without_memory(asked):
    matcher, plain = remembering(StereoMatcher(max_disparity=40)), StereoMatcher(max_disparity=40)
    expected = plain.disparity(LEFT, RIGHT, XY)
    assert expected[0] == pytest.approx(10, abs=0.1)
    asked.clear()
    for _ in range(3):
        np.testing.assert_array_equal(matcher.disparity(LEFT.copy(), RIGHT, XY), expected)
    assert len(asked) == 1


def test_every_other_question_is_asked(asked):
    matcher = remembering(StereoMatcher(max_disparity=40))
    for arguments in (
        (LEFT, RIGHT, XY),
        (RIGHT, LEFT, XY, False),
        (LEFT, RIGHT, XY[:2]),
        (LEFT, RIGHT, XY + 1),
        (LEFT, LEFT, XY),
        (RIGHT, LEFT, XY),
    ):
        matcher.disparity(*arguments)
    assert len(asked) == 6


def test_an_answer_can_be_changed_without_harm():
    matcher = remembering(StereoMatcher(max_disparity=40))
    first = matcher.disparity(LEFT, RIGHT, XY)
    first[:] = 0
    assert matcher.disparity(LEFT, RIGHT, XY)[0] > 5


def test_the_protocol_is_that_of_the_plain_matcher():
    plain = StereoMatcher(max_disparity=40, min_score=0.8)
    assert remembering(plain).parameters == plain.parameters
    assert isinstance(remembering(plain), RememberingMatcher)

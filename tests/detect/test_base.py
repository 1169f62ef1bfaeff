import numpy as np
import pytest

from sips_lit.detect.base import BaseDetector


class Middle(BaseDetector):
    name = "Middle"


def test_it_describes_nothing_and_says_so():
    assert Middle.describes is False
    with pytest.raises(TypeError, match="Middle has no descriptor of its own"):
        Middle().detect_and_describe(np.zeros((4, 4), np.uint8), 3)


def test_its_scores_are_an_order_without_a_map():
    assert Middle.scores == "order"
    assert Middle().score_map(np.zeros((4, 4), np.uint8)) is None

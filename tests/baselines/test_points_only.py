import numpy as np
import pytest

from sips_lit.baselines.points_only import PointsOnly


class Middle(PointsOnly):
    name = "Middle"


def test_it_describes_nothing_and_says_so():
    assert Middle.describes is False
    with pytest.raises(TypeError, match="Middle has no descriptor of its own"):
        Middle().detect_and_describe(np.zeros((4, 4), np.uint8), 3)

import runpy
from pathlib import Path

import numpy as np

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "precision_order.py"))


def test_the_share_by_hand():
    one = np.array([[0.0, 0], [10, 0], [20, 0], [30, 0]], np.float32)
    other = np.array([[10.0, 1], [0, 0], [21.1, 0], [30, 0]], np.float32)
    assert SCRIPT["share_of_both"](one, other, 2) == 1  # whatever their order
    assert SCRIPT["share_of_both"](one, other, 1) == 0
    assert SCRIPT["share_of_both"](one, other, 4) == 3 / 4

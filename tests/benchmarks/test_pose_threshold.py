import runpy
from pathlib import Path

import numpy as np
import pytest
from stereo_scenes import StereoScene

from sips_lit.baselines.sift import SiftDetector
from sips_lit.geometry.pose import PoseEstimate
from sips_lit.inference.match import PairMatcher

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "pose_threshold.py"))


def pose(angle: float, t: tuple[float, float, float]) -> np.ndarray:
    T = np.eye(4)
    T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    T[:3, 3] = t
    return T


def test_errors_by_hand():
    agreed = np.ones(5, np.bool_)
    turn, direction = SCRIPT["errors"](PoseEstimate(pose(np.radians(3), (0, 0, 1)), agreed), pose(0, (0, 2, 2)))
    assert turn == pytest.approx(3)
    assert direction == pytest.approx(45)
    assert SCRIPT["errors"](PoseEstimate(None, agreed), pose(0, (0, 0, 1))) == (np.inf, np.inf)
    assert SCRIPT["errors"](PoseEstimate(pose(0, (0, 0, 0)), agreed), pose(0, (0, 0, 1))) == (0, np.inf)


def test_a_row():
    """SIFT finds the pose of a scene with a threshold of one pixel, and not with one of a hundred-thousandth."""
    good, bad = SCRIPT["row"](PairMatcher(SiftDetector(), n=200), StereoScene(5), 2, 3, (1.0, 1e-5))
    assert min(float(number) for number in good.split(", ")) > 0.7
    assert float(good.split(", ")[1]) > float(bad.split(", ")[1])

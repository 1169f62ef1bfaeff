import math

import numpy as np
import pytest
from seen_points import pose, seen, world

from sips_lit.odometry.odometer import Located, Odometer, OdometrySettings, State
from sips_lit.odometry.result import OdometryResult, make_run, message_bytes
from sips_lit.types import Features, Keypoints


def features(n: int, descriptors: np.ndarray, norm) -> Features:
    ones = np.ones(n, np.float32)
    return Features(Keypoints(np.ones((n, 2), np.float32), ones, ones), descriptors, norm)


def test_a_point_weighs_four_bytes_and_its_descriptor():
    assert message_bytes(features(50, np.zeros((50, 32), np.uint8), "hamming")) == 50 * (4 + 32)
    assert message_bytes(features(10, np.zeros((10, 128), np.float32), "l2")) == 10 * (4 + 512)
    assert message_bytes(features(0, np.zeros((0, 128), np.float32), "l2")) == 0


def located(shift: float, state=State.TRACKED) -> Located:
    T = pose(1).copy()
    T[0, 3] += shift
    return Located(T, 10, state, False)


def runs() -> tuple:
    truth = np.stack([np.eye(4), pose(1)])
    first = Located(np.eye(4), 0, State.FIRST, True)
    return tuple(make_run([first, one], truth, 100) for one in (located(0.1), located(0.3, State.BRIDGED)))


def test_mean_and_deviation_over_the_seeds():
    result = OdometryResult("sift", "SIFT", 50, runs(), 50, 0, {})
    assert result.error("rpe_translation") == pytest.approx((0.2, np.std([0.1, 0.3], ddof=1)))
    assert result.bridged == pytest.approx((0.5, np.sqrt(0.5)))
    assert (result.keyframes, result.inliers) == (1, 10)
    alone = OdometryResult("sift", "SIFT", 50, runs()[:1], 50, 0, {})
    assert alone.error("rpe_translation") == (pytest.approx(0.1), 0)


def test_without_true_poses_there_are_no_errors():
    frames = [seen(i, world()) for i in range(3)]
    odometer = Odometer(OdometrySettings(iterations=50))
    run = make_run([odometer(frame) for frame in frames], np.full((3, 4, 4), np.nan), 100)
    assert run.errors is None
    assert math.isnan(OdometryResult("a", "A", 5, (run,), 5, 0, {}).error("drift")[0])
    assert run.bridged == 0

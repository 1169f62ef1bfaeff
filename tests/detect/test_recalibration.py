import math

import numpy as np
import pytest
import torch
from textured_scenes import texture
from tiny_network import tiny_network

from sips_lit.detect.budget import Budget
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.recalibration import AS_TRAINED, Recalibration
from sips_lit.detect.selection import PointSelector
from sips_lit.detect.shared_effect import logit
from sips_lit.types import Keypoints

SOME = Recalibration(0.6, 0.8, 0.3, 1.1)
IMAGE = texture(91, 133)


def detectors(scales: int = 1) -> tuple[SipsDetector, SipsDetector]:
    network = tiny_network(scales=scales)
    return SipsDetector(network, PointSelector(3)), SipsDetector(network, PointSelector(3, recalibration=SOME))


@pytest.mark.parametrize("scales", [1, 3])
@pytest.mark.parametrize("n", [1, 20, 60])
def test_the_same_points_with_the_probabilities_of_the_formula(scales, n):
    before, after = (detector(IMAGE, n) for detector in detectors(scales))
    np.testing.assert_array_equal(after.xy, before.xy)
    np.testing.assert_array_equal(after.scale, before.scale)
    expected = 0.6 * logit(before.score) + 0.8 + 0.3 * math.log(len(before) / 50)
    np.testing.assert_allclose(logit(after.score), expected, atol=1e-4)
    assert (np.diff(after.score) <= 0).all()


def test_nothing_by_default():
    logits = torch.randn(100)
    assert torch.equal(AS_TRAINED.logits(logits, 7), logits)
    points = Keypoints(np.zeros((3, 2), np.float32), np.array([0.9, 0.5, 0.1], np.float32), np.ones(3, np.float32))
    assert AS_TRAINED.best(points, 2).score is not points.score
    np.testing.assert_array_equal(AS_TRAINED.best(points, 2).score, points.score[:2])


@pytest.mark.parametrize("n", [0, 1, 10, 39, 40, 400])
def test_fewer_of_many_points_are_those_that_are_detected_so(n):
    detector = detectors()[1]
    fewer, asked = detector.best(detector(IMAGE, 40), n), detector(IMAGE, min(n, 40))
    np.testing.assert_array_equal(fewer.xy, asked.xy)
    np.testing.assert_allclose(fewer.score, asked.score, atol=1e-6)


def test_a_map_is_that_of_fifty_points():
    before, after = (detector.score_map(IMAGE) for detector in detectors())
    np.testing.assert_allclose(logit(after), 0.6 * logit(before) + 0.8, atol=1e-4)


def test_scores_of_certain_points_stay_so():
    ends = np.array([1.0, 0.0], np.float32)
    np.testing.assert_allclose(SOME.moved(ends, 50, 10), ends, atol=1e-7)
    assert len(SOME.moved(np.zeros(0, np.float32), 0, 0)) == 0


def test_a_budget_of_the_detector_is_that_of_its_points():
    detector = detectors()[1]
    budget = Budget(k=2, confidence=0.5, n_max=40)
    kept, enough = detector.within(IMAGE, budget)
    expected, as_expected = budget.keep(detector(IMAGE, 40), SOME)
    assert enough == as_expected
    np.testing.assert_array_equal(kept.xy, expected.xy)
    np.testing.assert_array_equal(kept.score, expected.score)
    np.testing.assert_allclose(kept.score, detector(IMAGE, len(kept)).score, atol=1e-6)


@pytest.mark.parametrize(
    "values",
    [
        {"scale": 0.0},
        {"scale": -1.0},
        {"scale": math.nan},
        {"offset": math.inf},
        {"log_n": -0.1},
        {"difficulty": -1.0},
        {"difficulty": 9.0},
    ],
)
def test_values_that_would_change_the_order_or_mean_nothing(values):
    with pytest.raises(ValueError, match=next(iter(values))):
        Recalibration(**values)

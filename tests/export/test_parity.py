import numpy as np
import pytest
import torch
from exported_models import RECALIBRATED, model_of
from tiny_network import tiny_network

from sips_lit.export.dense_map import DenseMap
from sips_lit.export.logits import LogitsOfImage
from sips_lit.export.parity import SHAPES, Difference, difference_of, difference_of_points
from sips_lit.types import Keypoints


def run_of(model):
    return lambda image: [output.numpy() for output in model(torch.from_numpy(image))]


@pytest.mark.parametrize("name", ["map", "best", "enough"])
def test_a_model_is_like_itself_and_unlike_another(name):
    model = model_of(name)
    same = difference_of(model, run_of(model))
    assert same.is_small
    assert (same.points > 10) == (name != "map")
    other = model_of(name)
    other.network.load_state_dict(tiny_network(1, derivatives=True).state_dict(), strict=False)
    other.logits = LogitsOfImage(other.network)  # whose weights are made beforehand
    assert not difference_of(model, run_of(other)).is_small


def test_what_is_not_a_number_is_no_small_difference():
    model = DenseMap(tiny_network(), RECALIBRATED)
    assert not difference_of(model, lambda image: [np.full(image.shape, np.nan, np.float32)]).is_small
    assert len(SHAPES) == 4


def test_points_that_moved_are_counted():
    xy = np.array([[3, 4], [10, 4], [20, 8]], np.float32)
    expected = Keypoints(xy, np.array([0.9, 0.5, 0.2], np.float32), np.ones(3, np.float32))

    def given(xy, score, count):
        outputs = {"keypoints": np.float32(xy), "scores": np.float32(score), "count": np.int64(count)}
        return difference_of_points(outputs, expected)

    padded = np.vstack([xy, [[-1, -1]]])
    assert given(padded, [0.9, 0.5, 0.2, 0], 3) == Difference(0, 3, 0)
    assert given(padded, [0.9, 0.5, 0.2, 0], 2) == Difference(0, 3, 1)
    assert given(padded + np.float32([[0, 0], [0, 0.5], [0, 0], [0, 0]]), [0.9, 0.5, 0.2, 0], 3).moved == 1
    assert given(padded[[1, 0, 2, 3]], [0.9, 0.5, 0.2, 0], 3).moved == 0, "order is for the scores to tell"
    assert given(padded, [0.9, 0.4, 0.2, 0], 3).score == pytest.approx(0.1)
    assert not Difference(0, 200, 3).is_small
    assert Difference(0, 200, 2).is_small
    assert str(Difference(2e-7, 200, 2)).startswith("198 of 200 points are the same")


def test_other_covariances_are_a_difference():
    model, other = model_of("enough"), model_of("enough")
    with torch.no_grad():
        other.network.covariance_head.bias[2] += 0.01  # the correlation alone
    difference = difference_of(model, run_of(other))
    assert (difference.moved, difference.is_small) == (0, False)
    assert difference.covariance > 1e-3
    assert "covariances by " in str(difference)

import numpy as np
import pytest
import torch
from exported_models import RECALIBRATED, SIZES, model_of, textured
from tiny_network import tiny_network

from sips_lit.detect.selection import PointSelector, score_map
from sips_lit.export.dense_map import DenseMap


@pytest.mark.parametrize("size", SIZES)
def test_it_is_the_detectors_map(size):
    model, image = model_of("map"), textured(size)
    (probability,) = model(torch.from_numpy(image)[None, None])
    assert probability.shape == (1, 1, *size)
    expected = score_map(model.network, image, RECALIBRATED.recalibration)
    np.testing.assert_allclose(probability[0, 0], expected, atol=1e-6)


def test_the_network_that_was_given_stays_trainable():
    network = tiny_network().train()
    DenseMap(network, PointSelector())
    assert network.training
    assert all(parameter.requires_grad for parameter in network.parameters())

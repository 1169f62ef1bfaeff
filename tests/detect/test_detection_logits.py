import numpy as np
import pytest
import torch
import torch.nn.functional as F
from textured_scenes import texture

from sips_lit.detect.corners import USUAL, corner_strength
from sips_lit.detect.detection_logits import detection_logits
from sips_lit.detect.selection import image_tensor


def test_it_is_added_to_the_mean_over_octaves():
    image = image_tensor(texture(30, 34, 3))
    plain = detection_logits(lambda x: x / 100, image, 2, 0)
    with torch.autocast("cpu", torch.bfloat16):
        found = detection_logits(lambda x: x / 100, image, 2, 0.25)
    torch.testing.assert_close(found, plain + 0.25 * corner_strength(image))


def test_half_precision_does_not_reach_the_eigenvalues():
    """Small differences of large numbers: rounded to bfloat16, a slanted edge would be a corner here and there."""
    rows, columns = np.mgrid[:60, :60]
    edge = image_tensor(np.clip(128 + 40 * (columns - 30 + 0.37 * (rows - 30)), 0, 255).astype(np.uint8))
    with torch.autocast("cpu", torch.bfloat16):
        found = detection_logits(lambda x: F.conv2d(x, torch.zeros(1, 1, 1, 1)), edge, 1, 1.0)
    torch.testing.assert_close(found, corner_strength(edge), rtol=0, atol=1e-4)
    image = edge.double()[0, 0].numpy()
    dy, dx = np.gradient(image)
    window = np.s_[24:36, 24:36]
    x, y = dx[window].ravel(), dy[window].ravel()
    smaller = np.linalg.eigvalsh(np.array([[x @ x, x @ y], [x @ y, y @ y]]) / 144)[0]
    assert found[0, 0, 29:31, 29:31].mean() == pytest.approx(np.log1p(smaller) - USUAL, abs=0.06)

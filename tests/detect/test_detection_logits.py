import numpy as np
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
    """Small differences of large numbers: in bfloat16 an edge would be a corner."""
    image = np.zeros((60, 60), np.uint8)
    image[:, 30:] = 255
    with torch.autocast("cpu", torch.bfloat16):
        found = detection_logits(lambda x: F.conv2d(x, torch.zeros(1, 1, 1, 1)), image_tensor(image), 1, 1.0)
    assert found.max() < -USUAL + 1e-3

from dataclasses import replace

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from textured_scenes import texture

from sips_lit.detect.corners import USUAL, corner_strength
from sips_lit.detect.detection_logits import Detection, detection_logits
from sips_lit.detect.octaves import mean_over_octaves
from sips_lit.detect.selection import image_tensor


def test_it_is_added_to_the_mean_over_octaves():
    image = image_tensor(texture(30, 34, 3))
    plain = mean_over_octaves(lambda x: x / 100, image, 2, 1)
    with torch.autocast("cpu", torch.bfloat16):
        found = detection_logits(lambda x: x / 100, image, Detection(2, 1, corners=0.25, fine_corners=0.5))
    torch.testing.assert_close(found, plain + corner_strength(image, 0.25, 0.5))
    torch.testing.assert_close(detection_logits(lambda x: x / 100, image, Detection(2, 1)), plain, rtol=0, atol=0)


def test_by_default_it_is_what_a_network_learns():
    image = image_tensor(texture(30, 34, 3))
    torch.testing.assert_close(detection_logits(lambda x: x / 100, image, Detection()), image / 100, rtol=0, atol=0)


HALF = Detection(2, 1, corners=0.25, fine_corners=0.5, whole_below=30 * 34)


@pytest.mark.parametrize("size", [(30, 33), (29, 34), (1, 1)])
def test_a_small_image_is_scored_whole_down_to_the_same_octave(size):
    image = image_tensor(texture(*size, 3))
    expected = detection_logits(lambda x: x / 100, image, Detection(3, corners=0.25))
    torch.testing.assert_close(detection_logits(lambda x: x / 100, image, HALF), expected, rtol=0, atol=0)


@pytest.mark.parametrize(
    ("asked", "whole"),
    [
        (Detection(2, 0.5, 0.5), Detection(3, 0, 0.5)),  # two thirds and half: the image, too
        (Detection(1, 1.5, 0.5), Detection(4, 0, 0.5)),
        (Detection(1, 0.5, 1), Detection(2, 0, 1)),  # half of it, too: two thirds are not among whole octaves
    ],
)
def test_so_is_one_that_begins_between_octaves(asked, whole):
    assert replace(asked, whole_below=1000).of(10, 10) == replace(whole, whole_below=1000)


def test_octaves_between_are_scored():
    image = image_tensor(texture(30, 34, 3))
    expected = mean_over_octaves(lambda x: x / 100, image, 2, 0.5, 0.5)
    found = detection_logits(lambda x: x / 100, image, Detection(2, 0.5, 0.5))
    torch.testing.assert_close(found, expected, rtol=0, atol=0)
    assert not torch.equal(found, detection_logits(lambda x: x / 100, image, Detection(2, 0.5, 1)))


@pytest.mark.parametrize("size", [(30, 34), (34, 30), (2, 510), (40, 40)])
def test_others_are_not(size):
    image = image_tensor(texture(*size, 3))
    expected = detection_logits(lambda x: x / 100, image, Detection(2, 1, corners=0.25, fine_corners=0.5))
    torch.testing.assert_close(detection_logits(lambda x: x / 100, image, HALF), expected, rtol=0, atol=0)


def test_what_begins_with_the_image_does_so_whatever_its_size():
    whole = Detection(2, corners=0.25, fine_corners=0.5, whole_below=10_000)
    assert whole.of(10, 10) == whole
    assert Detection(8, 7, whole_below=200).of(10, 10).octaves == 8  # the most that there are


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"octaves": 0}, "sees 1 to 8 octaves, not 0"),
        ({"octaves": 1.5}, "not 1.5"),
        ({"first_octave": -1}, r"first octave is 0 \(the image\) to 7, in steps of 0.5, not -1"),
        ({"first_octave": 8}, "not 8"),
        ({"first_octave": 7.5}, "not 7.5"),
        ({"first_octave": 0.75}, "in steps of 0.5, not 0.75"),
        ({"first_octave": float("nan")}, "not nan"),
        ({"octave_step": 2}, "octave_step is 1 or 0.5, not 2"),
        ({"octave_step": 0}, "not 0"),
        ({"corners": -0.1}, "corners weigh 0 to 10, not -0.1"),
        ({"fine_corners": 10.5}, "fine_corners weigh 0 to 10, not 10.5"),
        ({"fine_corners": float("nan")}, "not nan"),
        ({"whole_below": -1}, "whole_below is a number of pixels, 0 or more, not -1"),
        ({"whole_below": 0.5}, "not 0.5"),
    ],
)
def test_numbers_out_of_range_are_refused(options, told):
    with pytest.raises(ValueError, match=told):
        Detection(**options)


def test_half_precision_does_not_reach_the_eigenvalues():
    """Small differences of large numbers: rounded to bfloat16, a slanted edge would be a corner here and there."""
    rows, columns = np.mgrid[:60, :60]
    edge = image_tensor(np.clip(128 + 40 * (columns - 30 + 0.37 * (rows - 30)), 0, 255).astype(np.uint8))
    with torch.autocast("cpu", torch.bfloat16):
        found = detection_logits(lambda x: F.conv2d(x, torch.zeros(1, 1, 1, 1)), edge, Detection(corners=1.0))
    torch.testing.assert_close(found, corner_strength(edge), rtol=0, atol=1e-4)
    image = edge.double()[0, 0].numpy()
    dy, dx = np.gradient(image)
    window = np.s_[24:36, 24:36]
    x, y = dx[window].ravel(), dy[window].ravel()
    smaller = np.linalg.eigvalsh(np.array([[x @ x, x @ y], [x @ y, y @ y]]) / 144)[0]
    assert found[0, 0, 29:31, 29:31].mean() == pytest.approx(np.log1p(smaller) - USUAL, abs=0.06)

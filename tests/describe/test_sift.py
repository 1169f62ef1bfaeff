import cv2
import numpy as np
import pytest

from sips_lit.describe.sift import RootSift, SiftDescriptor
from sips_lit.errors import BadInputError
from sips_lit.types import Keypoints


def texture(seed=0, shape=(200, 240)):
    noise = np.random.default_rng(seed).integers(0, 255, shape).astype(np.uint8)
    blurred = cv2.GaussianBlur(noise, (0, 0), 2).astype(float)
    return np.clip((blurred - blurred.mean()) * 5 + 127, 0, 255).astype(np.uint8)


def keypoints_at(xy):
    xy = np.asarray(xy, np.float32)
    return Keypoints(xy, np.ones(len(xy), np.float32), np.ones(len(xy), np.float32))


INNER = np.random.default_rng(5).integers(80, 120, (20, 2)).astype(np.float32)


@pytest.mark.parametrize("size", [4.0, 8.0])
@pytest.mark.parametrize("scale", [0.5, 1.0, 1.125])
def test_unshrunk_it_is_opencv_at_angle_zero(size, scale):
    points = [cv2.KeyPoint(float(x), float(y), size * scale, angle=0) for x, y in INNER]
    _, expected = cv2.SIFT_create().compute(texture(), points)
    keypoints = Keypoints(INNER, np.ones(20, np.float32), np.full(20, scale, np.float32))
    np.testing.assert_array_equal(SiftDescriptor(size, shrink=1).describe(texture(), keypoints), expected)


def test_it_is_upright():
    """A turned image gives other descriptors, where one with an orientation would give the same."""
    image = texture()
    turned = np.ascontiguousarray(np.rot90(image))
    there = np.column_stack([INNER[:, 1], image.shape[1] - 1 - INNER[:, 0]])
    here = RootSift().describe(image, keypoints_at(INNER))
    assert np.linalg.norm(here - RootSift().describe(turned, keypoints_at(there)), axis=1).min() > 0.2


def test_horizontal_ramp_has_one_direction():
    """All gradients of a ramp along x are at angle 0: only the first of the 8 directions of each cell is filled."""
    ramp = np.repeat(np.arange(240, dtype=np.uint8)[None], 200, axis=0)
    cells = RootSift().describe(ramp, keypoints_at([[120, 100]])).reshape(16, 8)
    assert (cells[:, 0] > 0.1).all()
    np.testing.assert_allclose(cells[:, 1:], 0, atol=1e-6)


def test_root_sift_is_the_root_of_the_share():
    sift = SiftDescriptor().describe(texture(), keypoints_at(INNER)).astype(float)
    root = RootSift().describe(texture(), keypoints_at(INNER))
    assert root.dtype == np.float32
    for row, expected in zip(root, sift, strict=True):
        np.testing.assert_allclose(row, [np.sqrt(value / sum(expected)) for value in expected], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(root, axis=1), 1, atol=1e-5)


def test_brightness_and_contrast_do_not_matter():
    image = texture()
    dull = (image.astype(float) * 0.5 + 60).round().astype(np.uint8)
    apart = RootSift().describe(image, keypoints_at(INNER)) - RootSift().describe(dull, keypoints_at(INNER))
    assert np.linalg.norm(apart, axis=1).max() < 0.1


@pytest.mark.parametrize("arguments", [{"size": 0}, {"size": -3}, {"size": float("nan")}, {"shrink": 0.5}])
def test_senseless_arguments_are_refused(arguments):
    with pytest.raises(BadInputError, match=next(iter(arguments))):
        SiftDescriptor(**arguments)

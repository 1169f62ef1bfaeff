from collections import Counter

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.describe.scale_levels import LARGEST_RESIDUE, scale_levels
from sips_lit.types import Keypoints


def keypoints_at(xy, scale):
    xy = np.asarray(xy, np.float32).reshape(-1, 2)
    return Keypoints(xy, np.ones(len(xy), np.float32), np.broadcast_to(np.float32(scale), len(xy)).copy())


def blob(x, y, sigma, width, height):
    v, u = np.mgrid[:height, :width]
    return (20 + 200 * np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * sigma**2))).round().astype(np.uint8)


@settings(max_examples=30, deadline=None)
@given(scale=st.floats(1, 9), x=st.floats(40, 140), y=st.floats(40, 110), odd=st.integers(0, 5))
def test_a_point_stays_where_it_was_in_the_picture(scale, x, y, odd):
    image = blob(x, y, 8, 181 + odd, 150 + odd)
    (level,) = scale_levels(image, keypoints_at([x, y], scale), shrink=1.0, margin=5)
    weight = level.image.astype(float) - 20
    v, u = np.indices(level.image.shape)
    centre = np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum()
    np.testing.assert_allclose(level.xy[0], centre, atol=0.12)


@settings(max_examples=30, deadline=None)
@given(
    scales=st.lists(st.floats(0.3, 60), min_size=1, max_size=30),
    shrink=st.sampled_from([1.0, 2.0]),
    margin=st.integers(0, 20),
)
def test_every_point_is_served_once_with_its_margin(scales, shrink, margin):
    image = np.zeros((37, 53), np.uint8)
    corners = np.array([[0, 0], [52, 36], [52, 0], [0, 36]])
    keypoints = keypoints_at(corners[np.arange(len(scales)) % 4], 1)
    keypoints = Keypoints(keypoints.xy, keypoints.score, np.array(scales, np.float32))
    seen = Counter()
    for level in scale_levels(image, keypoints, shrink, margin):
        seen.update(level.rows.tolist())
        np.testing.assert_allclose(level.factor * level.residue, shrink * keypoints.scale[level.rows], rtol=1e-6)
        assert (level.residue <= LARGEST_RESIDUE + 1e-6).all()
        assert level.factor >= 1
        reach = np.array(level.image.shape[::-1]) - 1
        assert (level.xy >= margin - 0.6).all()
        assert (level.xy <= reach - margin + 0.6).all()
        assert max(level.image.shape) < 53 + 2 * margin + 2
    assert seen == Counter(range(len(scales)))


def test_scale_one_is_the_image_with_its_edge_repeated():
    image = np.random.default_rng(0).integers(0, 255, (20, 30)).astype(np.uint8)
    (level,) = scale_levels(image, keypoints_at([[3.5, 4.25]], 1), shrink=1.0, margin=7)
    np.testing.assert_array_equal(level.image, cv2.copyMakeBorder(image, 7, 7, 7, 7, cv2.BORDER_REPLICATE))
    np.testing.assert_array_equal(level.xy, [[10.5, 11.25]])


def test_half_size_is_the_mean_of_two_by_two():
    image = np.random.default_rng(0).integers(0, 255, (20, 30)).astype(np.uint8)
    (level,) = scale_levels(image, keypoints_at([[0.5, 0.5]], 1), shrink=2.0, margin=0)
    mean = image.reshape(10, 2, 15, 2).mean(axis=(1, 3))
    assert np.abs(level.image - mean).max() <= 0.5
    np.testing.assert_allclose(level.xy, [[0, 0]])


@pytest.mark.parametrize("scale", [1.0, 8.0])
def test_no_points_no_levels(scale):
    image = np.zeros((20, 30), np.uint8)
    assert list(scale_levels(image, keypoints_at([], scale), shrink=1.0, margin=3)) == []

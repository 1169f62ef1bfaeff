from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from textured_scenes import flight, keypoints, texture

from sips_lit.geometry.projection import apply_homography
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.pairs.sampler import read_pair
from sips_lit.train.augment import _largest_inside, turn_and_scale, turn_and_scale_pair
from sips_lit.types import Camera, Matches, ViewGeometry

FLIGHT = flight(6)
PAIR = read_pair(FLIGHT, 0, 5, between=False)
angles = st.floats(-1.6, 1.6)
scales = st.floats(0.6, 1.6)
sizes = st.integers(20, 90)


def blobs(places: np.ndarray, height: int, width: int, sigma: float = 2.0) -> np.ndarray:
    """Bright round spots."""
    y, x = np.mgrid[:height, :width]
    spots = [np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * sigma**2)) for u, v in places]
    return (200 * np.sum(spots, 0)).clip(0, 255).astype(np.uint8)


@given(angles, scales)
@settings(max_examples=40, deadline=None)
def test_a_spot_goes_where_the_map_says(angle, scale):
    place = np.array([[66.0, 48.5]])
    image = blobs(place, 101, 120)
    turned, A = turn_and_scale(image, angle, scale)
    (u, v) = apply_homography(A, place)[0]
    y, x = np.mgrid[: turned.shape[0], : turned.shape[1]]
    weights = turned.astype(float) ** 2
    seen = np.array([(x * weights).sum(), (y * weights).sum()]) / weights.sum()
    np.testing.assert_allclose(seen, [u, v], atol=0.08)


@given(sizes, sizes, angles, scales)
@settings(max_examples=100, deadline=None)
def test_nothing_comes_from_outside(width, height, angle, scale):
    turned, A = turn_and_scale(np.full((height, width), 200, np.uint8), angle, scale)
    h, w = turned.shape
    corners = np.array([[0, 0], [w - 1, 0], [0, h - 1], [w - 1, h - 1]], float)
    back = apply_homography(np.linalg.inv(A), corners)
    assert (back > -1e-6).all()
    assert (back < np.array([width, height]) - 1 + 1e-6).all()
    assert (turned == 200).all()
    np.testing.assert_allclose(np.linalg.det(A), scale**2)
    centre = apply_homography(A, np.array([[(width - 1) / 2, (height - 1) / 2]]))
    np.testing.assert_allclose(centre, [[(w - 1) / 2, (h - 1) / 2]])


@given(st.floats(5, 90), st.floats(5, 90), angles)
@settings(max_examples=60, deadline=None)
def test_no_upright_rectangle_inside_is_larger(width, height, angle):
    across, down = _largest_inside(width, height, angle)
    c, s = abs(np.cos(angle)), abs(np.sin(angle))
    # a rectangle is inside if its corner, turned back, is within half the sides
    tries = np.linspace(0, np.hypot(width, height), 400)
    limits = [(width - tries * c) / max(s, 1e-12), (height - tries * s) / max(c, 1e-12)]
    best = (tries * np.minimum(*limits)).max()
    assert across * down >= 0.999 * best
    assert across * c + down * s <= width * (1 + 1e-9)
    assert across * s + down * c <= height * (1 + 1e-9)


@given(st.tuples(angles, angles), st.tuples(scales, scales))
@settings(max_examples=30, deadline=None)
def test_the_homography_follows(pair_angles, pair_scales):
    turned = turn_and_scale_pair(PAIR, pair_angles, pair_scales)
    place = np.array([[70.0, 55], [90, 66], [81, 70]])
    maps = [
        turn_and_scale(image, angle, scale)[1]
        for image, angle, scale in zip((PAIR.image0, PAIR.image1), pair_angles, pair_scales, strict=True)
    ]
    in0, in1 = apply_homography(maps[0], place), apply_homography(maps[1], apply_homography(PAIR.homography, place))
    np.testing.assert_allclose(apply_homography(turned.homography, in0), in1, atol=1e-6)
    assert turned.frames[0] is turned.image0
    assert turned.frames[1] is turned.image1


@pytest.mark.parametrize(("angles", "scales"), [((1, -0.7), (1, 1)), ((0.3, 0.5), (1.4, 0.71)), ((0, 0), (0.71, 1.4))])
def test_images_agree_with_the_homography(angles, scales):
    turned = turn_and_scale_pair(PAIR, angles, scales)
    size = turned.image1.shape[::-1]
    seen = cv2.warpPerspective(turned.image0, turned.homography, size, flags=cv2.INTER_CUBIC)
    inside = cv2.warpPerspective(np.full_like(turned.image0, 255), turned.homography, size) == 255
    assert inside.sum() > 1500
    difference = np.abs(seen.astype(float) - turned.image1)
    assert np.median(difference[inside]) <= 6
    wrong = cv2.warpPerspective(turned.image0, PAIR.homography, size).astype(float)
    assert np.median(np.abs(wrong - turned.image1)) > 15  # the test can tell


def test_labels_stay():
    generator = np.random.default_rng(0)
    start = generator.uniform([60, 45], [100, 75], (80, 2))
    off = np.where(generator.random(80) < 0.5, 1.0, 6.0)
    goal = apply_homography(PAIR.homography, start) + off[:, None] * [0.6, 0.8]
    matches = Matches(np.arange(80), np.arange(80))
    before = HomographyInliers()(PAIR, keypoints(start), keypoints(goal), matches)
    for angles, scales in [((0.9, -0.9), (1, 1)), ((0.2, 1.0), (1.4, 0.8))]:
        turned = turn_and_scale_pair(PAIR, angles, scales)
        moved = [
            keypoints(apply_homography(turn_and_scale(image, angle, scale)[1], xy))
            for image, xy, angle, scale in zip((PAIR.image0, PAIR.image1), (start, goal), angles, scales, strict=True)
        ]
        after = HomographyInliers()(turned, *moved, matches)
        assert 20 < before.inlier.sum() < 60
        np.testing.assert_array_equal(before.inlier, after.inlier)


def test_shrinking_does_not_alias():
    stripes = np.tile(np.array([[0, 255]], np.uint8), (90, 60))
    turned, _ = turn_and_scale(stripes, 0.0, 2**-0.5)
    naive = cv2.resize(stripes, None, fx=2**-0.5, fy=1, interpolation=cv2.INTER_LINEAR)
    assert turned.astype(float).std() < 0.6 * naive.astype(float).std()


def test_nothing_is_done_by_nothing():
    turned, A = turn_and_scale(PAIR.image0, 0.0, 1.0)
    np.testing.assert_array_equal(turned, PAIR.image0)
    np.testing.assert_array_equal(A, np.eye(3))


def test_tiny_images():
    turned, A = turn_and_scale(texture(1, 1), 0.5, 0.7)
    assert turned.shape == (1, 1)
    assert np.isfinite(A).all()


def test_pairs_that_more_than_a_homography_joins():
    camera = Camera(np.eye(3), (160, 120))
    others = [
        replace(PAIR, homography=None),
        read_pair(FLIGHT, 0, 5),
        replace(PAIR, geometry=ViewGeometry(np.eye(4), camera, camera, None, None)),
    ]
    for pair in others:
        with pytest.raises(ValueError, match="nothing but a homography"):
            turn_and_scale_pair(pair, (0.1, 0), (1, 1))

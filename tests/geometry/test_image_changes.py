import cv2
import numpy as np
import pytest
from homographies import homographies, points
from hypothesis import given, settings
from hypothesis import strategies as st
from textured_scenes import texture

from sips_lit.frames.images import resize_max_side
from sips_lit.geometry.image_changes import flip_camera, flip_homography, flip_pose, resize_camera
from sips_lit.geometry.projection import apply_homography, transfer
from sips_lit.types import Camera

FLIPS = [(False, False), (True, False), (False, True), (True, True)]


def mirrored(xy: np.ndarray, size: tuple[int, int], horizontal: bool, vertical: bool) -> np.ndarray:
    x = size[0] - 1 - xy[:, 0] if horizontal else xy[:, 0]
    y = size[1] - 1 - xy[:, 1] if vertical else xy[:, 1]
    return np.stack([x, y], 1)


@given(homographies, points, st.sampled_from(FLIPS))
@settings(max_examples=60, deadline=None)
def test_mirrored_points_map_to_mirrored_points(H, xy, flip):
    size0, size1 = (160, 120), (201, 77)
    mapped = apply_homography(flip_homography(H, size0, size1, *flip), mirrored(xy, size0, *flip))
    np.testing.assert_allclose(mapped, mirrored(apply_homography(H, xy), size1, *flip), atol=1e-6)


@pytest.mark.parametrize(("horizontal", "vertical"), FLIPS)
def test_warping_a_mirrored_image_is_mirroring_the_warped_one(horizontal, vertical):
    H = np.array([[1.1, 0.05, 3], [-0.04, 0.95, 8], [2e-4, -1e-4, 1]])
    turn = slice(None, None, -1 if vertical else 1), slice(None, None, -1 if horizontal else 1)
    image, size1 = texture(70, 90), (100, 64)
    flipped = flip_homography(H, (90, 70), size1, horizontal, vertical)
    warped = cv2.warpPerspective(image, H, size1)[turn].astype(float)
    inner = slice(12, -12), slice(12, -12)
    difference = cv2.warpPerspective(np.ascontiguousarray(image[turn]), flipped, size1) - warped
    assert np.abs(difference[inner]).max() <= 12  # OpenCV 4 interpolates at steps of 1 / 32 pixel
    assert np.abs(difference[inner]).mean() < 0.7


@pytest.mark.parametrize(("horizontal", "vertical"), FLIPS)
def test_mirrored_points_with_depth_are_seen_where_the_mirrored_camera_sees_them(horizontal, vertical):
    rotation, _ = cv2.Rodrigues(np.array([0.1, -0.2, 0.3]))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, [0.3, -0.2, 0.1]
    size0, size1 = (160, 120), (201, 77)
    camera0 = Camera(np.array([[150.0, 0.5, 71], [0, 140, 66], [0, 0, 1]]), size0)
    camera1 = Camera(np.array([[170.0, 0, 95], [0, 180, 40], [0, 0, 1]]), size1)
    generator = np.random.default_rng(0)
    xy, depth = generator.uniform(0, 100, (20, 2)), generator.uniform(2, 9, 20)
    seen, deep = transfer(xy, depth, camera0, camera1, T)
    flip = (horizontal, vertical)
    seen_mirrored, deep_mirrored = transfer(
        mirrored(xy, size0, *flip), depth, flip_camera(camera0, *flip), flip_camera(camera1, *flip), flip_pose(T, *flip)
    )
    np.testing.assert_allclose(seen_mirrored, mirrored(seen, size1, *flip), atol=1e-9)
    np.testing.assert_allclose(deep_mirrored, deep)
    assert np.linalg.det(flip_pose(T, *flip)[:3, :3]) == pytest.approx(1)  # still a rotation


def camera(width: int, height: int) -> Camera:
    return Camera(np.array([[100.0, 0, 37.25], [0, 90.0, 21.5], [0, 0, 1]]), (width, height))


@pytest.mark.parametrize("size", [(32, 24), (31, 24), (64, 48), (100, 30)])
def test_a_pixel_stays_where_it_was_in_the_scene(size):
    big, small = camera(64, 48), resize_camera(camera(64, 48), size)
    ray = np.array([0.1, -0.2, 1.0])
    x, y, _ = big.matrix @ ray
    moved = ((x + 0.5) * size[0] / 64 - 0.5, (y + 0.5) * size[1] / 48 - 0.5, 1.0)
    np.testing.assert_allclose(small.matrix @ ray, moved, atol=1e-12)
    assert small.size == size


def test_a_spot_is_found_where_the_resized_camera_says():
    image = np.zeros((96, 128), np.uint8)
    image[40:48, 80:88] = 255  # its centre is (83.5, 43.5)
    spot = Camera(np.array([[1.0, 0, 83.5], [0, 1.0, 43.5], [0, 0, 1]]), (128, 96))
    small = resize_max_side(image, 50)
    moments = cv2.moments(small)
    found = moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]
    np.testing.assert_allclose(
        resize_camera(spot, small.shape[::-1]).matrix[:2, 2], found, atol=0.05
    )  # grey values are whole; half a pixel forgotten: 0.3


def test_the_same_size_changes_nothing():
    np.testing.assert_array_equal(resize_camera(camera(64, 48), (64, 48)).matrix, camera(64, 48).matrix)
    image = texture(48, 64)
    assert resize_max_side(image, 64) is image

import cv2
import numpy as np
import pytest
from textured_scenes import texture

from sips_lit.frames.images import resize_max_side
from sips_lit.geometry.resize import resize_camera
from sips_lit.types import Camera


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

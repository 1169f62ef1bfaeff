import numpy as np
import pytest
from drawing_threads import in_threads
from textured_scenes import keypoints, texture

from sips_lit.render.canvas import probability_colours
from sips_lit.render.points import RADIUS, draw_points
from sips_lit.types import Keypoints


@pytest.mark.parametrize("colour", [False, True])
def test_the_picture_has_the_size_of_the_image(colour):
    image = texture(90, 121)
    image = np.dstack([image, image // 2, image // 3]) if colour else image
    before = image.copy()
    picture = draw_points(image, keypoints([[20, 20], [100, 40]]))
    assert picture.shape == (90, 121, 3)
    assert picture.dtype == np.uint8
    np.testing.assert_array_equal(image, before)
    assert not np.array_equal(picture, draw_points(image, Keypoints.empty()))


def test_the_colour_tells_the_probability():
    picture = draw_points(np.full((100, 150, 3), 60, np.uint8), keypoints([[30, 40], [90, 40]], [1.0, 0.02]))
    sure, unsure = probability_colours(np.array([1.0, 0.02]))
    reach = int(RADIUS)
    np.testing.assert_array_equal(picture[40, 30 + reach], sure)
    assert np.abs(picture[40, 90 - reach].astype(int) - unsure).max() <= 30
    np.testing.assert_array_equal(picture[40, 60], [60, 60, 60])


def test_scores_beyond_probabilities_are_drawn_as_the_end():
    image = np.full((60, 90), 60, np.uint8)
    certain = draw_points(image, keypoints([[30, 30]], [1.0]))
    np.testing.assert_array_equal(draw_points(image, keypoints([[30, 30]], [250.0])), certain)


def test_the_radius_grows_with_the_scale():
    image = np.full((100, 100), 60, np.uint8)
    for scale in (1.0, 2.0, 4.0):
        picture = draw_points(image, keypoints([[50, 45]], [1.0], scale))
        np.testing.assert_array_equal(picture[45, 50 + int(RADIUS * scale)], probability_colours(np.array(1.0)))


def test_better_points_lie_on_top():
    image = np.full((60, 60), 60, np.uint8)
    picture = draw_points(image, keypoints([[30, 30], [30, 30]], [1.0, 0.6]))
    np.testing.assert_array_equal(picture[30, 35], probability_colours(np.array(1.0)))


def test_the_legend_is_in_the_corner_of_large_images_only():
    image = np.full((240, 640), 200, np.uint8)
    picture = draw_points(image, Keypoints.empty())
    changed = np.any(picture != 200, axis=2)
    assert changed[-30:, :200].mean() > 0.9
    assert not changed[:200].any()
    few, many = draw_points(image, keypoints([[500, 50]])), draw_points(image, keypoints([[500, 50]] * 12))
    assert not np.array_equal(few[-30:, :200], many[-30:, :200])  # it counts
    small = draw_points(image[:60, :80], Keypoints.empty())
    assert np.all(small == 200)


@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1)])
def test_tiny_images_and_points_outside(shape):
    picture = draw_points(np.zeros(shape, np.uint8), keypoints([[0, 0], [-80, 4], [1e5, 1e5]]))
    assert picture.shape == (*shape, 3)
    assert draw_points(np.zeros(shape, np.uint8), Keypoints.empty()).max() == 0


def test_threads_draw_the_same():
    image, points = texture(120, 400), keypoints(np.random.default_rng(0).uniform(0, 120, (50, 2)))
    expected = draw_points(image, points)
    for picture in in_threads(lambda: draw_points(image, points)):
        np.testing.assert_array_equal(picture, expected)

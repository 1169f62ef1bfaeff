import matplotlib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.render.canvas import (
    BLACK,
    WHITE,
    draw_lines,
    draw_point,
    draw_ring,
    draw_text,
    probability_colours,
    text_width,
    to_picture,
)
from sips_lit.render.matches import COLOURS

RED, GREEN = (255, 0, 0), (0, 255, 0)
INK = 220  # OpenCV's smooth lines are not quite opaque


def black(height: int = 40, width: int = 60) -> np.ndarray:
    return np.zeros((height, width, 3), np.uint8)


def test_to_picture_is_an_rgb_copy():
    grey = np.arange(12, dtype=np.uint8).reshape(3, 4)
    picture = to_picture(grey)
    assert picture.shape == (3, 4, 3)
    assert picture.dtype == np.uint8
    for channel in range(3):
        np.testing.assert_array_equal(picture[:, :, channel], grey)
    picture[:] = 9
    assert grey.max() == 11
    rgb = np.dstack([grey, grey + 20, grey + 40])
    copy = to_picture(rgb)
    np.testing.assert_array_equal(copy, rgb)
    copy[:] = 0
    assert rgb.max() == 51


def test_probabilities_are_viridis():
    levels = np.linspace(0, 1, 256)
    expected = matplotlib.colormaps["viridis"](levels, bytes=True)[:, :3]
    assert np.abs(probability_colours(levels).astype(int) - expected).max() <= 3


@pytest.mark.parametrize("shape", [(), (0,), (5,), (2, 3)])
def test_colours_have_the_shape_of_the_probabilities(shape):
    colours = probability_colours(np.full(shape, 0.5, np.float32))
    assert colours.shape == (*shape, 3)
    assert colours.dtype == np.uint8


def test_probabilities_out_of_range_are_clipped():
    ends = probability_colours(np.array([0.0, 1.0]))
    np.testing.assert_array_equal(probability_colours(np.array([-7.0, 300.0])), ends)
    np.testing.assert_array_equal(probability_colours(np.array([-np.inf, np.inf])), ends)
    assert ends[1].sum() > ends[0].sum()


def test_a_ring_is_where_it_should_be():
    picture = black()
    draw_ring(picture, np.array([30, 20]), 8, 2, RED)
    for dx, dy in ((8, 0), (-8, 0), (0, 8), (0, -8)):
        assert tuple(picture[20 + dy, 30 + dx]) == RED
    assert tuple(picture[20, 30]) == BLACK
    assert tuple(picture[20, 42]) == BLACK
    rows, columns = np.nonzero(picture[:, :, 0])
    assert np.all(np.abs(np.hypot(rows - 20, columns - 30) - 8) < 1.5)


def test_ink_grows_evenly_with_the_thickness():
    ink = []
    for thickness in (0.75, 1.0, 1.5, 2.0, 3.0):
        picture = black()
        draw_ring(picture, np.array([30.3, 19.6]), 9, thickness, WHITE)
        ink.append(picture[:, :, 0].sum() / 255)
    np.testing.assert_allclose(ink, 2 * np.pi * 9 * np.array([0.75, 1.0, 1.5, 2.0, 3.0]), rtol=0.05)


@settings(max_examples=40, deadline=None)
@given(
    x=st.floats(-30, 90),
    y=st.floats(-30, 70),
    radius=st.floats(0, 25),
    thickness=st.floats(0.2, 6),
    opacity=st.floats(0, 1),
)
def test_a_ring_anywhere_is_as_pixel_by_pixel(x, y, radius, thickness, opacity):
    picture, expected = np.full((30, 50, 3), 90, np.uint8), np.full((30, 50, 3), 90.0)
    draw_ring(picture, np.array([x, y]), radius, thickness, (200, 10, 90), opacity)
    for row in range(30):
        for column in range(50):
            distance = abs(float(np.hypot(column - x, row - y)) - radius)
            cover = opacity * min(max(thickness / 2 + 0.5 - distance, 0), 1)
            expected[row, column] += cover * (np.array([200, 10, 90]) - 90)
    assert np.abs(picture - expected).max() <= 0.51


def test_a_thicker_ring_means_a_more_probable_point():
    ink = []
    for probability in (-1.0, 0.0, 0.5, 1.0, 7.0):
        picture = np.full((40, 60, 3), 90, np.uint8)
        draw_point(picture, np.array([30, 20]), 9, probability, GREEN)
        assert picture[20, 39, 1] > 200
        assert picture[17, 30, 1] == 90
        ink.append(int((picture[:, :, 1] > 128).sum()))
    assert ink[0] == ink[1] < ink[2] < ink[3] == ink[4]


def test_the_rim_is_darker_than_the_ground():
    picture = np.full((40, 60, 3), 200, np.uint8)
    draw_point(picture, np.array([30, 20]), 9, 0.0, WHITE)
    assert picture[:, :, 0].min() < 110
    assert picture[20, 39, 0] > 220


@pytest.mark.parametrize("colour", [*COLOURS.values(), *map(tuple, probability_colours(np.linspace(0, 1, 9)).tolist())])
@pytest.mark.parametrize("ground", [0, 40, 128, 215, 255])
@pytest.mark.parametrize("probability", [0.0, 1.0])
def test_a_point_shows_on_dark_and_on_bright_ground(colour, ground, probability):
    """Its line or its rim differs from the ground by a ratio of 3 (WCAG's of graphics); white on middle grey has but 3.9."""
    picture = np.full((40, 60, 3), ground, np.uint8)
    draw_point(picture, np.array([30, 20]), 9, probability, colour)
    drawn, behind = luminance(picture[20, 36:44]), luminance(np.full(3, ground))
    assert max((np.maximum(drawn, behind) + 0.05) / (np.minimum(drawn, behind) + 0.05)) >= (2.5 if ground == 128 else 3)


def luminance(colours: np.ndarray) -> np.ndarray:
    """Relative luminance of sRGB colours (..., 3) by WCAG's definition."""
    part = colours / 255
    linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    return linear @ np.array([0.2126, 0.7152, 0.0722])


def test_lines_join_their_ends_and_nothing_else():
    picture = black()
    draw_lines(picture, np.array([[5, 5], [5, 30]]), np.array([[50, 5], [50, 30]]), RED, opacity=1.0)
    for row in (5, 30):
        assert picture[row, 6:50, 0].min() > INK
        assert not picture[row, :, 1:].any()
    assert not picture[8:28].any()
    assert not picture[:, 54:].any()


def test_opacity_mixes_with_what_is_below():
    picture = np.full((20, 60, 3), 100, np.uint8)
    draw_lines(picture, np.array([[5, 10]]), np.array([[50, 10]]), (200, 0, 100), opacity=0.5)
    np.testing.assert_allclose(picture[10, 25], (150, 50, 100), atol=6)
    assert picture[10, 25, 2] == 100


@pytest.mark.parametrize(
    ("start", "end"), [((-20, 10), (80, 10)), ((-9, -9), (-2, -3)), ((500, 500), (600, 510)), ((7, 7), (7, 7))]
)
def test_lines_may_leave_the_picture(start, end):
    picture = black()
    draw_lines(picture, np.array([start]), np.array([end]), RED, opacity=1.0)
    if start == (-20, 10):
        assert picture[10, 1:-1, 0].min() > INK
    if start in ((-9, -9), (500, 500)):
        assert not picture.any()
    if start == end:
        assert picture[7, 7, 0] > 0
        assert picture[:, :, 0].astype(bool).sum() < 20


def test_no_lines():
    picture = black()
    draw_lines(picture, np.zeros((0, 2)), np.zeros((0, 2)), RED, opacity=1.0)
    assert not picture.any()


def test_text_ends_where_it_says():
    picture = black(40, 200)
    end = draw_text(picture, "50 points", 10, 25, 15)
    columns = np.flatnonzero(picture.any((0, 2)))
    assert end == 10 + text_width("50 points", 15)
    assert columns[0] >= 10
    assert abs(columns[-1] - end) <= 4
    rows = np.flatnonzero(picture.any((1, 2)))
    assert 8 <= rows[0] < rows[-1] <= 31
    assert text_width("50 points", 30) > 1.8 * text_width("50 points", 15)

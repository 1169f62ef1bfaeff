import numpy as np
import pytest

from sips_lit.render.canvas import probability_colours, text_width
from sips_lit.render.caption import GROUND, caption, probability_key, ring_key, words


def block(width: int, level: int) -> np.ndarray:
    return np.full((30, width, 3), level, np.uint8)


def test_pieces_stand_in_lines_in_their_order():
    picture = caption([block(100, 50), block(80, 90), block(60, 130)], 240)
    assert picture.shape == (2 * 30 + 2 * 10, 240, 3)
    first, second = picture[25, :, 0], picture[55, :, 0]
    assert [level for level in dict.fromkeys(first.tolist()) if level != GROUND] == [50, 90]
    assert (first == 50).sum() == 100
    assert [level for level in dict.fromkeys(second.tolist()) if level != GROUND] == [130]


@pytest.mark.parametrize("width", [1, 9, 50])
def test_what_is_wider_than_a_line_is_cut(width):
    picture = caption([block(200, 50), block(10, 90)], width)
    assert picture.shape[1] == width
    assert picture.shape[0] == 2 * 30 + 2 * 10


def test_keys_show_their_colours():
    key = ring_key("far", (226, 94, 0), 20)
    assert np.any(np.all(key == (226, 94, 0), axis=2))
    bar = probability_key("P", 20)
    for probability in (0, 1):
        assert np.any(np.all(bar == probability_colours(np.array(float(probability))), axis=2))
    assert words("50 points", 20).shape[1] == text_width("50 points", 20)

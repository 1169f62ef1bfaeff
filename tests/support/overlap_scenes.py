"""Scenes for the tests of overlap: flights, cuts, flat frames, and upright views of a plane, in an order or in none."""

import numpy as np
from textured_scenes import ArraySequence, film

SCENES = {
    "flight": lambda: film(14),
    "fast": lambda: film(12, step=(14, 6), zoom=1.0),
    "cut": lambda: ArraySequence(film(6).frames + film(7, seed=8).frames),
    "flat": lambda: ArraySequence([np.full((60, 70), 9, np.uint8)] * 4),
    "flat in between": lambda: ArraySequence([*film(4).frames, np.full((120, 160), 9, np.uint8), *film(3).frames]),
    "one frame": lambda: film(1),
    "no frame": lambda: ArraySequence([]),
}


class Unordered(ArraySequence):
    """Views of one plane in no order."""

    temporal = False


def views(*windows: tuple[int, int, int, int]) -> Unordered:
    """Upright views of a plane, one for each window (x, y, W, H) of it."""
    frames = [np.zeros((height, width), np.uint8) for _, _, width, height in windows]
    return Unordered(frames, "views", [np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1.0]]) for x, y, _, _ in windows])


def there_and_back(*windows: tuple[int, int, int, int]) -> ArraySequence:
    """As `views`, in the order in which a moving camera saw them."""
    unordered = views(*windows)
    return ArraySequence(unordered.frames, "there and back", unordered.to_frame)

"""The points of one image, drawn on it."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from sips_lit.render.canvas import Picture, draw_point, draw_text, probability_colours, text_width, to_picture
from sips_lit.types import Keypoints

RADIUS: Final = 5.0
"""Pixels, of a point at full resolution."""


def draw_points(image: NDArray[np.uint8], keypoints: Keypoints) -> Picture:
    """The image (H, W) grey or (H, W, 3) RGB with a circle at each point: RGB uint8 (H, W, 3).

    The radius grows with the point's scale; colour and thickness tell its probability of being an inlier, with a
    legend in the corner where the image has room for it. Scores outside [0, 1] are drawn as the nearer end.
    """
    picture = to_picture(image)
    colours = probability_colours(keypoints.score)
    # The best points come last, on top of the others.
    for index in reversed(range(len(keypoints))):
        red, green, blue = colours[index].tolist()
        radius = RADIUS * float(keypoints.scale[index])
        draw_point(picture, keypoints.xy[index], radius, float(keypoints.score[index]), (red, green, blue))
    _draw_legend(picture, len(keypoints))
    return picture


def _draw_legend(picture: Picture, points: int) -> None:
    """How many points, and which colour is which probability, in the lower left corner."""
    size, margin = 14, 8
    text, title = f"{points} points", "P(inlier)  0"
    bar = 72
    lengths = [text_width(text, size), text_width(title, size), bar, text_width("1", size)]
    width, height = sum(lengths) + 7 * margin, size + 2 * margin
    if width > picture.shape[1] or 4 * height > picture.shape[0]:
        return
    box = picture[-height:, :width]
    box[:] = box // 4
    baseline = height - margin - 1
    left = draw_text(box, text, margin, baseline, size) + 2 * margin
    left = draw_text(box, title, left, baseline, size) + margin
    box[margin + 1 : height - margin, left : left + bar] = probability_colours(np.linspace(0, 1, bar))
    draw_text(box, "1", left + bar + margin, baseline, size)

"""A caption beneath a picture: words, and keys of colours, in as many lines as they need."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from sips_lit.render.canvas import (
    Colour,
    Picture,
    draw_ring,
    draw_text,
    probability_colours,
    text_width,
)

GROUND: Final = 24
"""Grey level."""


def caption(pieces: Sequence[Picture], width: int) -> Picture:
    """The pieces (of one height) from left to right, in as many lines as ``width`` asks for: RGB uint8 (H, width, 3).

    What is wider than a line is cut off.
    """
    height = pieces[0].shape[0]
    between, margin = height // 2, height // 3
    lines: list[list[Picture]] = [[]]
    left = margin
    for piece in pieces:
        if lines[-1] and left + piece.shape[1] + margin > width:
            lines.append([])
            left = margin
        lines[-1].append(piece)
        left += piece.shape[1] + between
    strip: Picture = np.full((height * len(lines) + 2 * margin, width, 3), GROUND, np.uint8)
    for row, line in enumerate(lines):
        left, top = margin, margin + row * height
        for piece in line:
            part = piece[:, : max(0, width - left)]
            strip[top : top + height, left : left + part.shape[1]] = part
            left += piece.shape[1] + between
    return strip


def words(text: str, size: int) -> Picture:
    """A piece of text, of about ``size`` pixels."""
    piece = _blank(text_width(text, size), size)
    draw_text(piece, text, 0, _baseline(size), size)
    return piece


def ring_key(text: str, colour: Colour, size: int) -> Picture:
    """A piece that says what circles of a colour mean."""
    room = round(1.2 * size)
    piece = _blank(room + text_width(text, size), size)
    draw_ring(piece, np.array([size / 2, _baseline(size) - size / 3]), 0.27 * size, 0.2 * size, colour)
    draw_text(piece, text, room, _baseline(size), size, colour)
    return piece


def probability_key(title: str, size: int) -> Picture:
    """A piece with the colours of probabilities from 0 to 1."""
    bar, gap = 5 * size, size // 3
    left = text_width(f"{title}  0", size) + gap
    piece = _blank(left + bar + gap + text_width("1", size), size)
    draw_text(piece, f"{title}  0", 0, _baseline(size), size)
    top, bottom = _baseline(size) - round(0.75 * size), _baseline(size) + 1
    piece[top:bottom, left : left + bar] = probability_colours(np.linspace(0, 1, bar))
    draw_text(piece, "1", left + bar + gap, _baseline(size), size)
    return piece


def _blank(width: int, size: int) -> Picture:
    return np.full((round(1.7 * size), width, 3), GROUND, np.uint8)


def _baseline(size: int) -> int:
    return round(1.2 * size)

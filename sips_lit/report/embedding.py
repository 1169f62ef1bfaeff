"""Figures and pictures as text within a page, so that it needs no other file."""

from __future__ import annotations

import base64
import io
import re
from pathlib import Path
from typing import Final

import cv2
import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from sips_lit.errors import BadInputError
from sips_lit.render.canvas import Picture

_JPEG_QUALITY: Final = 78
_ENLARGED: Final = 1.6  # pixels a point (1/72 inch) of a figure at most
_WIDEST: Final = 960  # pixels of a picture in the page; the file beside it has them all


def svg_of(figure: Figure) -> str:
    """The figure as SVG with real text, the same for the same figure."""
    text = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "sips_lit"}):
        # savefig draws the figure twice, once only to lay it out
        FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None})  # type: ignore[no-untyped-call]  # as in render/figure.py
    return text.getvalue()


def inline_svg(figure: Figure, prefix: str, description: str) -> Markup:
    """The figure for the middle of a page: as wide as its container, ``prefix`` before all its ids.

    Curves (ids ``curve-…``) get a class of that name instead, as a page has the same curve in several figures.
    ``description`` is for those who cannot see it.
    """
    svg = svg_of(figure)
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'<g id="(curve-\d+)">', r'<g class="\1">', svg)
    svg = re.sub(r'\bid="', f'id="{prefix}-', svg)
    svg = re.sub(r'(url\(|href=")#', rf"\1#{prefix}-", svg)
    opening, rest = svg.split(">", 1)
    widest = round(_ENLARGED * figure.get_figwidth() * 72)  # or a small figure's letters would be headlines
    opening = re.sub(r' (width|height)="[^"]*"', "", opening)
    # Markup, so that the template inserts the SVG as it is: matplotlib has escaped all texts in it, and escaping the tags
    # would show them instead of the figure. The description is the only other text from outside.
    return Markup(f'{opening} style="max-width: {widest}px" role="img" aria-label="{escape(description)}">{rest}')


def picture_uri(image: Picture | Path) -> str:
    """A data URI of a picture, RGB uint8 (H, W, 3) or a file, no wider than the page shows it.

    Raises BadInputError when the file cannot be read.
    """
    bgr = cv2.imread(str(image)) if isinstance(image, Path) else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    if bgr is None:
        raise BadInputError(f"the picture {image} cannot be read: draw it again, or leave it out")
    shrink = _WIDEST / bgr.shape[1]
    if shrink < 1:
        bgr = cv2.resize(bgr, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1]
    return f"data:image/jpeg;base64,{base64.b64encode(np.asarray(jpeg).tobytes()).decode()}"

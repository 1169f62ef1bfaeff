import base64
import re
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest
from markupsafe import Markup

from sips_lit.errors import BadInputError
from sips_lit.render.comparison import draw_comparison
from sips_lit.render.styles import detector_styles
from sips_lit.report.embedding import inline_svg, picture_uri


def figure():
    return draw_comparison({"a": ([0, 1], [0, 1])}, detector_styles(["a"]), {"a": "a"}, legend=False)


def test_ids_are_of_this_figure_and_curves_are_classes():
    root = ET.fromstring(inline_svg(figure(), "set-0-x", "what it shows"))
    nodes = list(root.iter())
    assert all(node.get("id", "set-0-x-").startswith("set-0-x-") for node in nodes)
    assert [node.get("class") for node in nodes if node.get("class")] == ["curve-0"]
    assert "width" not in root.attrib
    assert "height" not in root.attrib
    assert root.get("aria-label") == "what it shows"
    assert inline_svg(figure(), "p", "d") == inline_svg(figure(), "p", "d")


def decoded(uri: str) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(base64.b64decode(uri.partition(",")[2]), np.uint8), cv2.IMREAD_COLOR)


def test_pictures_keep_their_colours_and_shrink(tmp_path):
    red = np.zeros((100, 2000, 3), np.uint8)
    red[..., 0] = 200
    cv2.imwrite(str(tmp_path / "red.png"), red[..., ::-1])
    for image in (red, tmp_path / "red.png"):
        shown = decoded(picture_uri(image))
        assert shown.shape == (48, 960, 3)
        assert np.abs(shown.astype(int) - (0, 0, 200)).max() < 8


def test_a_picture_that_is_not_there(tmp_path):
    with pytest.raises(BadInputError, match=r"no\.png cannot be read"):
        picture_uri(tmp_path / "no.png")


def test_a_small_figure_stays_small():
    small, large = figure(), figure()
    large.set_size_inches(2 * small.get_figwidth(), small.get_figheight())
    widths = [re.search(r"max-width: (\d+)px", inline_svg(f, "p", "d"))[1] for f in (small, large)]
    assert int(widths[1]) == pytest.approx(2 * int(widths[0]), abs=1)


def test_the_description_is_escaped():
    svg = inline_svg(figure(), "p", '<b>"&')
    assert ET.fromstring(svg).get("aria-label") == '<b>"&'
    assert Markup.escape(svg) == svg  # a template takes it as it is

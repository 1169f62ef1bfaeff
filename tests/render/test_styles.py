import matplotlib.colors
import numpy as np

from sips_lit.render.curves import draw_succinctness_curves
from sips_lit.render.figure import figure_to_array
from sips_lit.render.styles import detector_styles, is_control, literal


def test_one_colour_a_detector_and_one_line_a_descriptor():
    styles = detector_styles(["SIFT", "SIFT + RootSIFT", "ORB", "SIFT"])
    assert list(styles) == ["SIFT", "SIFT + RootSIFT", "ORB"]
    assert styles["SIFT"].colour == styles["SIFT + RootSIFT"].colour != styles["ORB"].colour
    assert (styles["SIFT"].line, styles["SIFT + RootSIFT"].line) == ("--", "-")
    assert [style.index for style in styles.values()] == [0, 1, 2]


def test_thirteen_detectors_twice_are_all_different():
    names = [name for i in range(13) for name in (f"d{i}", f"d{i} + RootSIFT")]
    styles = detector_styles(names)
    assert len({(style.colour, style.line, style.marker) for style in styles.values()}) == 26


def test_controls_are_grey():
    styles = detector_styles(["random + RootSIFT", "grid + RootSIFT", "SIPs + RootSIFT"])
    for name, style in styles.items():
        red, green, blue = matplotlib.colors.to_rgb(style.colour)
        assert (red == green == blue) == is_control(name)
    assert not is_control("randomised")


def test_names_are_shown_as_they_are():
    assert literal("a$b$") == r"a\$b\$"
    names = ["_hidden", "$\\bad{$", "a < b"]
    curves = {name: np.linspace(0, 1, 21) for name in names}
    figure = draw_succinctness_curves(curves, dict.fromkeys(names, 0.5), detector_styles(names), 3)
    assert len(figure.axes[0].get_legend().get_texts()) == 3
    figure_to_array(figure)

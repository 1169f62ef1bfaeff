import matplotlib.colors
import numpy as np

from sips_lit.render.benchmark_curves import draw_succinctness_curves
from sips_lit.render.detector_looks import detector_looks, is_control, literal
from sips_lit.render.figure import figure_to_array


def test_one_colour_a_detector_and_one_line_a_descriptor():
    looks = detector_looks(["SIFT", "SIFT + RootSIFT", "ORB", "SIFT"])
    assert list(looks) == ["SIFT", "SIFT + RootSIFT", "ORB"]
    assert looks["SIFT"].colour == looks["SIFT + RootSIFT"].colour != looks["ORB"].colour
    assert (looks["SIFT"].line, looks["SIFT + RootSIFT"].line) == ("--", "-")
    assert [look.index for look in looks.values()] == [0, 1, 2]


def test_thirteen_detectors_twice_are_all_different():
    names = [name for i in range(13) for name in (f"d{i}", f"d{i} + RootSIFT")]
    looks = detector_looks(names)
    assert len({(look.colour, look.line, look.marker) for look in looks.values()}) == 26


def test_controls_are_grey():
    looks = detector_looks(["random + RootSIFT", "grid + RootSIFT", "SIPs + RootSIFT"])
    for name, look in looks.items():
        red, green, blue = matplotlib.colors.to_rgb(look.colour)
        assert (red == green == blue) == is_control(name)
    assert not is_control("randomised")


def test_names_are_shown_as_they_are():
    assert literal("a$b$") == r"a\$b\$"
    names = ["_hidden", "$\\bad{$", "a < b"]
    curves = {name: np.linspace(0, 1, 21) for name in names}
    figure = draw_succinctness_curves(curves, dict.fromkeys(names, 0.5), detector_looks(names), 3)
    assert len(figure.axes[0].get_legend().get_texts()) == 3
    figure_to_array(figure)

import numpy as np

from sips_lit.render.styles import detector_styles
from sips_lit.render.trajectories import draw_against_n, draw_trajectories

STYLES = detector_styles(["SIFT", "ORB"])


def test_the_axes_are_those_of_the_longest_ways(caplog):
    truth = np.column_stack([np.linspace(0, 5, 9), np.zeros(9), np.linspace(0, 50, 9)])
    figure = draw_trajectories(
        {"n = 10": {"SIFT": truth + 1, "ORB": 100 * truth}, "n = 50": {"SIFT": truth, "ORB": truth}}, truth, STYLES
    )
    first, second = figure.axes
    assert (first.get_xlabel(), first.get_ylabel(), second.get_title()) == ("x (m)", "z (m)", "n = 50")
    np.testing.assert_array_equal(first.lines[1].get_xydata(), truth[:, [0, 2]] + 1)
    figure.canvas.draw()
    assert not caplog.records  # matplotlib logs limits that it ignores
    assert first.get_xlim()[0] < 0 < 5 < first.get_xlim()[1] < 100  # the truth is in sight, what is astray is not
    assert -20 < first.get_ylim()[0] < 0 < 50 < first.get_ylim()[1] < 70
    assert [text.get_text() for text in second.get_legend().get_texts()] == ["true", "SIFT", "ORB"]
    figure = draw_trajectories({"n = 10": {"SIFT": truth[:, [1, 2, 0]]}}, None, STYLES)
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("y (m)", "z (m)")


def test_an_error_against_n():
    values = {"SIFT": (np.array([4.0, 2.0]), np.array([1.0, 0.5])), "ORB": (np.array([8.0, 3.0]), np.zeros(2))}
    (axes,) = draw_against_n(values, [10, 50], STYLES, "drift").axes
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), [[10, 4], [50, 2]])
    assert [text.get_text() for text in axes.get_xticklabels()] == ["10", "50"]
    assert axes.get_yscale() == axes.get_xscale() == "log"

import numpy as np

from sips_lit.render.figure import figure_to_array
from sips_lit.render.pose_curves import draw_pose_curves
from sips_lit.render.styles import detector_styles

CURVES = {"a": (np.array([0, 0.2, 1]), np.array([0, 0.5, 0.5])), "b": (np.array([0, 1.0]), np.zeros(2))}


def test_steps_with_their_auc():
    figure = draw_pose_curves(CURVES, {"a": 0.4, "b": 0.0}, detector_styles("ab"), 1.0, "translation error, m")
    (axes,) = figure.axes
    assert [t.get_text() for t in axes.get_legend().get_texts()] == ["a  0.400", "b  0.000"]
    assert axes.get_xlabel() == "translation error, m"
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), CURVES["a"][0])
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), CURVES["a"][1])
    assert axes.lines[0].get_drawstyle() == "steps-post"


def test_the_best_comes_first_whatever_the_order():
    figure = draw_pose_curves(CURVES, {"a": 0.1, "b": 0.3}, detector_styles("ab"), 2.5, "rotation error, degrees")
    (axes,) = figure.axes
    assert [t.get_text() for t in axes.get_legend().get_texts()] == ["b  0.300", "a  0.100"]
    assert [line.get_gid() for line in axes.lines] == ["curve-1", "curve-0"]  # a style stays its detector's
    assert axes.get_xlim() == (0, 2.5)
    assert axes.get_ylim()[0] == 0
    assert axes.get_ylim()[1] > 1


def test_no_detectors_and_no_legend():
    figure_to_array(draw_pose_curves({}, {}, {}, 1.0, "error"))
    figure = draw_pose_curves(CURVES, {"a": 0.1, "b": 0.3}, detector_styles("ab"), 1.0, "error", legend=False)
    assert figure.axes[0].get_legend() is None

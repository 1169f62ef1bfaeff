import matplotlib.colors
import numpy as np
from drawing_threads import in_threads

from sips_lit.metrics.succinctness import SuccinctnessResult, histogram, summarise
from sips_lit.render.curves import draw_against_k, draw_pose_curves, draw_succinctness, draw_succinctness_curves
from sips_lit.render.figure import LINE_COLOURS, figure_to_array
from sips_lit.render.styles import detector_styles

NAMES = ["bad", "good + X"]
LOOKS = detector_styles(NAMES)
POSE_CURVES = {"a": (np.array([0, 0.2, 1]), np.array([0, 0.5, 0.5])), "b": (np.array([0, 1.0]), np.zeros(2))}


def result(n_k: list[int | None], k: int = 3, n_max: int = 20) -> SuccinctnessResult:
    return summarise(histogram(n_k, n_max), k)


GOOD, BAD = result([4, 5, 5, 9]), result([10, 15, None, None])


def test_the_curve_is_the_result():
    for found, at_80 in ((GOOD, "80 % at n = 9"), (BAD, "never 80 %")):
        (axes,) = draw_succinctness("SIPs", found).axes
        (line,) = (line for line in axes.lines if not line.get_label().startswith("_"))
        np.testing.assert_array_equal(line.get_ydata(), found.curve)
        assert line.get_label() == f"SIPs: AUC {found.auc:.3f}, {at_80}"


def test_the_bound_is_a_step_at_k():
    figure = draw_succinctness("good", GOOD)
    bound = figure.axes[0].lines[0]
    np.testing.assert_array_equal(bound.get_ydata(), [0] * 3 + [1] * 18)
    assert figure.axes[0].get_xlim() == (0, 20)
    assert any(text.get_text() == "k = 3" for text in figure.axes[0].texts)


def test_the_curve_has_the_first_colour_in_the_picture():
    picture = figure_to_array(draw_succinctness("good", GOOD))
    colour = np.rint(255 * np.array(matplotlib.colors.to_rgb(LINE_COLOURS[0])))
    assert np.sum(np.all(np.abs(picture - colour) < 8, axis=2)) > 100


def test_no_pairs_at_all():
    assert figure_to_array(draw_succinctness("nothing", result([]))).shape == (630, 960, 3)


def test_threads_draw_the_same():
    expected = figure_to_array(draw_succinctness("good", GOOD))
    for array in in_threads(lambda: figure_to_array(draw_succinctness("good", GOOD)), 4):
        np.testing.assert_array_equal(array, expected)


def texts(figure):
    return [text.get_text() for text in figure.axes[0].get_legend().get_texts()]


def by_id(figure):
    return {line.get_gid(): line for line in figure.axes[0].lines if str(line.get_gid()).startswith("curve")}


def test_curves_are_steps_best_first():
    curves = {"bad": np.linspace(0, 0.5, 21), "good + X": np.linspace(0, 1, 21)}
    figure = draw_succinctness_curves(curves, {"bad": 0.2, "good + X": 0.5}, LOOKS, 3)
    assert texts(figure) == ["good + X  0.500", "bad  0.200"]
    for name, curve in curves.items():
        line = by_id(figure)[f"curve-{LOOKS[name].index}"]
        np.testing.assert_array_equal(line.get_ydata(), curve)
        assert (line.get_color(), line.get_drawstyle()) == (LOOKS[name].colour, "steps-post")
    bound = next(line for line in figure.axes[0].lines if list(line.get_xdata()) == [0, 3, 3, 20])
    assert list(bound.get_ydata()) == [0, 0, 1, 1]


def test_the_legend_stands_outside_however_long():
    names = [f"detector number {i}" for i in range(26)]
    curves = {name: np.linspace(0, 1, 21) for name in names}
    figure = draw_succinctness_curves(curves, dict.fromkeys(names, 0.5), detector_styles(names), 3)
    figure_to_array(figure)
    axes = figure.axes[0]
    legend, plot, page = axes.get_legend().get_window_extent(), axes.get_window_extent(), figure.bbox
    assert legend.x0 >= plot.x1
    assert legend.y0 >= page.y0
    assert legend.x1 <= page.x1
    assert plot.width > 0.4 * page.width


def test_nothing_to_draw_and_unknown_values():
    figure_to_array(draw_succinctness_curves({}, {}, {}, 10))
    unknown = {"bad": np.full(21, np.nan)}
    assert texts(draw_succinctness_curves(unknown, {"bad": np.nan}, LOOKS, 3)) == ["bad  nan"]
    one_known = unknown | {"good + X": np.linspace(0, 1, 21)}
    aucs = {"bad": np.nan, "good + X": 0.0}
    assert texts(draw_succinctness_curves(one_known, aucs, LOOKS, 3)) == ["good + X  0.000", "bad  nan"]


def test_against_k_in_order_of_k():
    values = {"bad": np.array([0.1, 0.3, 0.2]), "good + X": np.array([0.7, 0.9, np.nan])}
    figure = draw_against_k(values, LOOKS, (10, 5, 7), "AUC")
    assert texts(figure) == ["good + X", "bad"]
    line = by_id(figure)["curve-0"]
    assert list(line.get_xdata()) == [5, 7, 10]
    assert list(line.get_ydata()) == [0.3, 0.2, 0.1]
    assert draw_against_k(values, LOOKS, (10, 5, 7), "AUC", legend=False).axes[0].get_legend() is None


def test_pose_curves_are_steps_with_their_auc():
    figure = draw_pose_curves(POSE_CURVES, {"a": 0.4, "b": 0.0}, detector_styles("ab"), 1.0, "translation error, m")
    (axes,) = figure.axes
    assert [t.get_text() for t in axes.get_legend().get_texts()] == ["a  0.400", "b  0.000"]
    assert axes.get_xlabel() == "translation error, m"
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), POSE_CURVES["a"][0])
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), POSE_CURVES["a"][1])
    assert axes.lines[0].get_drawstyle() == "steps-post"


def test_the_best_poses_come_first_whatever_the_order():
    figure = draw_pose_curves(POSE_CURVES, {"a": 0.1, "b": 0.3}, detector_styles("ab"), 2.5, "rotation error, degrees")
    (axes,) = figure.axes
    assert [t.get_text() for t in axes.get_legend().get_texts()] == ["b  0.300", "a  0.100"]
    assert [line.get_gid() for line in axes.lines] == ["curve-1", "curve-0"]  # a style stays its detector's
    assert axes.get_xlim() == (0, 2.5)
    assert axes.get_ylim()[0] == 0
    assert axes.get_ylim()[1] > 1


def test_pose_curves_of_no_detectors_and_without_a_legend():
    figure_to_array(draw_pose_curves({}, {}, {}, 1.0, "error"))
    figure = draw_pose_curves(POSE_CURVES, {"a": 0.1, "b": 0.3}, detector_styles("ab"), 1.0, "error", legend=False)
    assert figure.axes[0].get_legend() is None

import numpy as np

from sips_lit.render.benchmark_curves import draw_against_k, draw_succinctness_curves
from sips_lit.render.figure import figure_to_array
from sips_lit.render.styles import detector_styles

NAMES = ["bad", "good + X"]
LOOKS = detector_styles(NAMES)


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


def test_against_k_in_order_of_k():
    values = {"bad": np.array([0.1, 0.3, 0.2]), "good + X": np.array([0.7, 0.9, np.nan])}
    figure = draw_against_k(values, LOOKS, (10, 5, 7), "AUC")
    assert texts(figure) == ["good + X", "bad"]
    line = by_id(figure)["curve-0"]
    assert list(line.get_xdata()) == [5, 7, 10]
    assert list(line.get_ydata()) == [0.3, 0.2, 0.1]
    assert draw_against_k(values, LOOKS, (10, 5, 7), "AUC", legend=False).axes[0].get_legend() is None

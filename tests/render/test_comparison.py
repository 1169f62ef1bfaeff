import numpy as np
import pytest
from drawing_threads import in_threads

from sips_lit.render.comparison import ENTRY_HEIGHT, HEIGHT, draw_comparison, draw_curve, new_chart, put_legend
from sips_lit.render.figure import figure_to_array
from sips_lit.render.styles import Style, detector_styles

STYLE = Style(7, "#112233", "--", "s")


def test_curves_in_order_with_their_styles_and_labels():
    styles = detector_styles(["SIFT", "ORB + RootSIFT"])
    curves = {"ORB + RootSIFT": ([0, 2], [1, 0]), "SIFT": ([0, 1, 2], [0, 0.5, 1])}
    labels = {"SIFT": "best", "ORB + RootSIFT": "second"}
    figure = draw_comparison(curves, styles, labels, xlabel="points", ylim=(0, 2))
    (axes,) = figure.axes
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["second", "best"]
    for line, (name, (x, y)) in zip(axes.lines, curves.items(), strict=True):
        assert (list(line.get_xdata()), list(line.get_ydata())) == (x, y)
        assert line.get_gid() == f"curve-{styles[name].index}"
        assert (line.get_color(), line.get_linestyle()) == (styles[name].colour, styles[name].line)
        assert line.get_drawstyle() == "default"
    assert (axes.get_xlabel(), axes.get_ylim()) == ("points", (0, 2))


@pytest.mark.parametrize(("steps", "drawn"), [(False, "default"), (True, "steps-post")])
def test_with_steps_a_value_holds_until_the_next(steps, drawn):
    axes = new_chart(1, legend=False).add_subplot()
    draw_curve(axes, [0, 1], [3, 4], STYLE, "$name$", steps)
    (line,) = axes.lines
    assert line.get_drawstyle() == drawn
    assert (line.get_color(), line.get_linestyle(), line.get_marker()) == ("#112233", "--", "s")
    assert line.get_label() == r"\$name\$"  # no formula


def test_the_legend_has_room_for_all_entries():
    plain, few, many = new_chart(3, False), new_chart(3, True), new_chart(40, True)
    assert few.get_figwidth() > plain.get_figwidth()
    assert few.get_figheight() == plain.get_figheight() == HEIGHT
    assert many.get_figheight() >= 40 * ENTRY_HEIGHT
    assert new_chart(3, True, height=9).get_figheight() == 9


def test_the_legend_stands_beside_the_axes():
    figure = draw_comparison({"a": ([0, 1], [0, 1])}, {"a": STYLE}, {"a": "a"})
    figure_to_array(figure)
    (axes,) = figure.axes
    assert axes.get_legend().get_window_extent().x0 >= axes.get_window_extent().x1


def test_nothing_to_draw():
    figure = draw_comparison({}, {}, {})
    assert figure.axes[0].get_legend() is None
    put_legend(figure.axes[0])
    assert figure.axes[0].get_legend() is None
    figure_to_array(figure)
    without = draw_comparison({"a": ([0, 1], [0, 1])}, {"a": STYLE}, {"a": "a"}, legend=False)
    assert without.axes[0].get_legend() is None


def test_threads_draw_the_same():
    def draw():
        return figure_to_array(draw_comparison({"a": ([0, 1], [0, 1])}, {"a": STYLE}, {"a": "a"}))

    expected = draw()
    for picture in in_threads(draw, 4):
        np.testing.assert_array_equal(picture, expected)

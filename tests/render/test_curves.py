import matplotlib.colors
import numpy as np
import pytest
from drawing_threads import in_threads
from matplotlib.figure import Figure

from sips_lit.metrics.succinctness import SuccinctnessResult, histogram, summarise
from sips_lit.render.curves import draw_succinctness
from sips_lit.render.figure import LINE_COLOURS, figure_to_array


def result(n_k: list[int | None], k: int = 3, n_max: int = 20) -> SuccinctnessResult:
    return summarise(histogram(n_k, n_max), k)


GOOD, BAD = result([4, 5, 5, 9]), result([10, 15, None, None])


def curves(figure: Figure) -> dict[str, np.ndarray]:
    """Heights of each labelled curve."""
    (axes,) = figure.axes
    return {line.get_label(): line.get_ydata() for line in axes.lines if not line.get_label().startswith("_")}


def test_curves_are_the_results():
    drawn = curves(draw_succinctness({"bad": BAD, "good": GOOD}))
    assert [label.split(":")[0] for label in drawn] == ["good", "bad"]  # best first
    for (label, heights), expected in zip(drawn.items(), (GOOD, BAD), strict=True):
        np.testing.assert_array_equal(heights, expected.curve)
        assert f"AUC {expected.auc:.3f}" in label
    good, bad = drawn
    assert "80 % at n = 9" in good
    assert "never 80 %" in bad


def test_the_bound_is_a_step_at_k():
    figure = draw_succinctness({"good": GOOD})
    bound = figure.axes[0].lines[0]
    np.testing.assert_array_equal(bound.get_ydata(), [0] * 3 + [1] * 18)
    assert figure.axes[0].get_xlim() == (0, 20)
    assert any(text.get_text() == "k = 3" for text in figure.axes[0].texts)


def test_the_best_curve_has_the_first_colour_in_the_picture():
    picture = figure_to_array(draw_succinctness({"good": GOOD}))
    colour = np.rint(255 * np.array(matplotlib.colors.to_rgb(LINE_COLOURS[0])))
    assert np.sum(np.all(np.abs(picture - colour) < 8, axis=2)) > 100


def test_many_detectors_are_told_apart():
    count = 2 * len(LINE_COLOURS) + 1
    figure = draw_succinctness({f"d{i}": result([5 + i % 7, 9]) for i in range(count)})
    styles = {(line.get_color(), line.get_linestyle()) for line in figure.axes[0].lines[2:]}
    assert len(styles) == count


def test_no_pairs_at_all():
    figure = draw_succinctness({"nothing": result([]), "good": GOOD})
    assert [label.split(":")[0] for label in curves(figure)] == ["good", "nothing"]
    assert figure_to_array(figure).shape == (630, 960, 3)
    figure_to_array(draw_succinctness({"nothing": result([])}))


def test_results_that_cannot_be_compared():
    with pytest.raises(ValueError, match="no results"):
        draw_succinctness({})
    with pytest.raises(ValueError, match="k = 3 with n_max = 20, k = 4 with n_max = 20"):
        draw_succinctness({"a": GOOD, "b": result([5], k=4)})


def test_threads_draw_the_same():
    expected = figure_to_array(draw_succinctness({"good": GOOD}))
    for array in in_threads(lambda: figure_to_array(draw_succinctness({"good": GOOD})), 4):
        np.testing.assert_array_equal(array, expected)

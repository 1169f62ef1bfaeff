import warnings

import numpy as np

from sips_lit.metrics.calibration import CalibrationResult, bin_sums, summarise
from sips_lit.render.calibration_counts import draw_calibrations
from sips_lit.render.figure import figure_to_array
from sips_lit.render.styles import detector_styles


def calibration(scores: list[float], labels: list[int], bins: int = 20) -> CalibrationResult:
    return summarise(bin_sums(scores, labels, bins))


GOOD, NONE = calibration([0.12, 0.13, 0.97], [0, 1, 1]), calibration([], [])


def line(axes, index):
    return next(line for line in axes.lines if line.get_gid() == f"curve-{index}")


def test_dots_above_and_counts_below():
    figure = draw_calibrations({"none": NONE, "good": GOOD}, detector_styles(["none", "good"]))
    upper, lower = figure.axes
    dots = line(upper, 1)
    np.testing.assert_allclose(dots.get_xdata(), [0.125, 0.97])
    np.testing.assert_allclose(dots.get_ydata(), [0.5, 1])
    counts = line(lower, 1)
    assert list(counts.get_ydata()) == [*GOOD.count, 1]
    np.testing.assert_allclose(counts.get_xdata(), np.linspace(0, 1, 21))
    assert counts.get_drawstyle() == "steps-post"
    assert lower.get_yscale() == "log"
    assert upper.get_legend().get_texts()[0].get_text().startswith("good")
    figure_to_array(figure)


def test_the_diagonal_is_perfect_and_the_best_comes_first():
    wrong = calibration([0.9, 0.8], [0, 0])
    figure = draw_calibrations({"wrong": wrong, "good": GOOD}, detector_styles(["wrong", "good"]))
    diagonal, *curves = figure.axes[0].lines
    assert (list(diagonal.get_xdata()), list(diagonal.get_ydata())) == ([0, 1], [0, 1])
    assert [curve.get_gid() for curve in curves] == ["curve-1", "curve-0"]
    texts = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert texts == [f"good  {GOOD.ece:.3f}", "wrong  0.850"]


def test_all_counts_are_seen():
    many = calibration([0.5] * 5000, [1] * 5000)
    low, high = draw_calibrations({"a": many}, detector_styles("a")).axes[1].get_ylim()
    assert low < 1
    assert high > 5000


def test_nothing_to_draw():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure_to_array(draw_calibrations({}, {}))
        figure_to_array(draw_calibrations({"none": NONE}, detector_styles(["none"]), legend=False))

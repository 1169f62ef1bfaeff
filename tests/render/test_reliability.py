import warnings

import numpy as np
import pytest
from drawing_threads import in_threads
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.figure import Figure

from sips_lit.metrics.calibration import CalibrationResult, bin_sums, summarise
from sips_lit.render.figure import figure_to_array
from sips_lit.render.reliability import draw_calibrations, draw_reliability
from sips_lit.render.styles import detector_styles


def calibration(scores: list[float], labels: list[bool], bins: int = 10) -> CalibrationResult:
    return summarise(bin_sums(np.array(scores), np.array(labels), bins))


# 4 points near 0.15, one an inlier, and 2 near 0.95, both inliers
RESULT = calibration([0.14, 0.15, 0.15, 0.16, 0.94, 0.96], [True, False, False, False, True, True])
GOOD, NONE = calibration([0.12, 0.13, 0.97], [0, 1, 1], 20), calibration([], [], 20)


def bars(figure: Figure, axes: int) -> dict[float, float]:
    """Height of each bar by its left end."""
    (container,) = (c for c in figure.axes[axes].containers if isinstance(c, BarContainer))
    return {round(float(bar.get_x()), 6): float(bar.get_height()) for bar in container}


def intervals(figure: Figure) -> np.ndarray:
    """(bins, 2): the ends of each bar's interval."""
    (container,) = (c for c in figure.axes[0].containers if isinstance(c, ErrorbarContainer))
    return np.array([segment[:, 1] for segment in container[2][0].get_segments()])


def test_bars_are_frequencies_and_counts_of_the_filled_bins():
    figure = draw_reliability(RESULT)
    assert bars(figure, 0) == pytest.approx({0.1: 0.25, 0.9: 1.0})
    assert bars(figure, 1) == pytest.approx({0.1: 4, 0.9: 2})
    assert figure.axes[1].get_yscale() == "log"
    assert "points (6)" in figure.axes[1].get_ylabel()
    assert f"ECE {RESULT.ece:.3f}" in figure.axes[0].get_title()


def test_intervals_are_wilsons():
    # 1 of 4 and 2 of 2 at 95 %, as the score interval is solved: |p - f| = z sqrt(p (1 - p) / n)
    for (low, high), frequency, count in zip(intervals(draw_reliability(RESULT)), (0.25, 1.0), (4, 2), strict=True):
        p = np.linspace(0, 1, 200001)
        inside = p[np.abs(p - frequency) <= 1.96 * np.sqrt(p * (1 - p) / count)]
        assert low == pytest.approx(inside.min(), abs=1e-4)
        assert high == pytest.approx(inside.max(), abs=1e-4)


def test_dots_stand_at_the_mean_probability():
    (container,) = (c for c in draw_reliability(RESULT).axes[0].containers if isinstance(c, ErrorbarContainer))
    np.testing.assert_allclose(container[0].get_xdata(), [0.15, 0.95])


@pytest.mark.parametrize(
    "result",
    [
        calibration([], []),
        calibration([1.0], [True], bins=1),
        calibration([0.0, 1.0], [False, True]),
        calibration([0.5], [False], bins=20),
    ],
)
def test_empty_bins_and_certain_points(result):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        picture = figure_to_array(draw_reliability(result))
    assert picture.shape == (840, 750, 3)
    assert picture.dtype == np.uint8


def test_threads_draw_the_same():
    expected = figure_to_array(draw_reliability(RESULT))
    for array in in_threads(lambda: figure_to_array(draw_reliability(RESULT)), 4):
        np.testing.assert_array_equal(array, expected)


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
    wrong = calibration([0.9, 0.8], [0, 0], 20)
    figure = draw_calibrations({"wrong": wrong, "good": GOOD}, detector_styles(["wrong", "good"]))
    diagonal, *curves = figure.axes[0].lines
    assert (list(diagonal.get_xdata()), list(diagonal.get_ydata())) == ([0, 1], [0, 1])
    assert [curve.get_gid() for curve in curves] == ["curve-1", "curve-0"]
    texts = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert texts == [f"good  {GOOD.ece:.3f}", "wrong  0.850"]


def test_all_counts_are_seen():
    many = calibration([0.5] * 5000, [1] * 5000, 20)
    low, high = draw_calibrations({"a": many}, detector_styles("a")).axes[1].get_ylim()
    assert low < 1
    assert high > 5000


def test_no_calibration_to_draw():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure_to_array(draw_calibrations({}, {}))
        figure_to_array(draw_calibrations({"none": NONE}, detector_styles(["none"]), legend=False))

import numpy as np

from sips_lit.metrics.calibration import bin_sums, summarise
from sips_lit.render.calibration_counts import draw_calibrations
from sips_lit.render.figure import figure_to_array
from sips_lit.render.pose_curves import draw_pose_curves
from sips_lit.render.pose_difference import draw_pose_differences
from sips_lit.render.styles import detector_styles


def test_pose_curves():
    curves = {"a": (np.array([0, 0.2, 1]), np.array([0, 0.5, 0.5])), "b": (np.array([0, 1.0]), np.zeros(2))}
    figure = draw_pose_curves(curves, {"a": 0.4, "b": 0.0}, detector_styles("ab"), 1.0, "translation error, m")
    (axes,) = figure.axes
    assert [t.get_text() for t in axes.get_legend().get_texts()] == ["a  0.400", "b  0.000"]
    assert axes.get_xlabel() == "translation error, m"
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), curves["a"][1])


def test_calibration_has_the_counts_below():
    good = summarise(bin_sums([0.12, 0.13, 0.97], [0, 1, 1], 20))
    none = summarise(bin_sums([], [], 20))
    figure = draw_calibrations({"none": none, "good": good}, detector_styles(["none", "good"]))
    upper, lower = figure.axes
    dots = next(line for line in upper.lines if line.get_gid() == "curve-1")
    np.testing.assert_allclose(dots.get_xdata(), [0.125, 0.97])
    np.testing.assert_allclose(dots.get_ydata(), [0.5, 1])
    counts = next(line for line in lower.lines if line.get_gid() == "curve-1")
    assert list(counts.get_ydata()) == [*good.count, 1]
    assert upper.get_legend().get_texts()[0].get_text().startswith("good")
    figure_to_array(figure)


def test_pairs_are_in_the_band_of_their_points():
    needed = np.array([12, 49, 50, 100, 101, np.inf, 20.0])
    where = np.array([1, 2, 3, 4, 5, 6, np.nan])
    figure = draw_pose_differences({"a": needed, "b": needed}, where, where * 2)
    bands = {c.get_label(): c.get_offsets() for c in figure.axes[0].collections}
    known = {
        label: np.asarray(xy)[~np.isnan(np.ma.filled(xy, np.nan)[:, 0]), 0].tolist() for label, xy in bands.items()
    }
    assert known == {"n < 50": [1, 2], "50 to 100": [3, 4], "> 100": [5], "failed": [6]}
    figure_to_array(figure)
    figure_to_array(draw_pose_differences({}, where, where))

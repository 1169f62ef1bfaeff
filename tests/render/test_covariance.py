import numpy as np

from sips_lit.metrics.covariance import summarise
from sips_lit.render.covariance import draw_covariance_reliability


def test_the_curve_is_the_share_within_each_ellipse():
    result = summarise(np.array([5.0, 3.0, 1.0, 1.0, 20.0, 0.0]))  # four bins, sum of d^2, of log-determinants
    figure = draw_covariance_reliability({"desk": result})
    diagonal, curve = figure.axes[0].lines
    np.testing.assert_array_equal(diagonal.get_xdata(), diagonal.get_ydata())
    np.testing.assert_allclose(curve.get_xdata(), [0, 0.25, 0.5, 0.75, 1])
    np.testing.assert_allclose(curve.get_ydata(), [0, 0.5, 0.8, 0.9, 1])
    assert "factor 1.00 (10 residuals)" in curve.get_label()


def test_nothing_to_draw():
    assert draw_covariance_reliability({"none": summarise(np.zeros(6))}).axes

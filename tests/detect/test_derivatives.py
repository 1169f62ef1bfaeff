import cv2
import numpy as np
import pytest
import torch

from sips_lit.detect.derivatives import CHANNELS, derivative_channels, derivative_filters


def channels(image: np.ndarray) -> np.ndarray:
    return derivative_channels(torch.from_numpy(image.astype(np.float32))[None, None], derivative_filters())[0].numpy()


def test_those_of_a_quadratic_surface_are_known():
    """f = a x^2 + b x y + c y^2 + d x + e y + g, whose derivatives are exact for central differences."""
    a, b, c, d, e, g = 0.02, -0.03, 0.05, 0.1, -0.2, 0.3
    y, x = np.mgrid[0:9, 0:11].astype(np.float64)
    grey, dx, dy, xx, yy, xy, hessian = channels(a * x**2 + b * x * y + c * y**2 + d * x + e * y + g)
    x, y = x[1:-1, 1:-1], y[1:-1, 1:-1]
    fx, fy = 4 * (2 * a * x + b * y + d), 4 * (2 * c * y + b * x + e)
    np.testing.assert_allclose(grey, a * x**2 + b * x * y + c * y**2 + d * x + e * y + g, atol=1e-6)
    np.testing.assert_allclose(dx, fx, atol=1e-5)
    np.testing.assert_allclose(dy, fy, atol=1e-5)
    np.testing.assert_allclose(xx, np.log1p(fx**2), atol=1e-4)
    np.testing.assert_allclose(yy, np.log1p(fy**2), atol=1e-4)
    np.testing.assert_allclose(xy, np.sign(fx * fy) * np.log1p(np.abs(fx * fy)), atol=1e-4)
    determinant = 16 * (4 * a * c - b**2)
    np.testing.assert_allclose(hessian, np.full_like(x, np.log1p(determinant)), atol=1e-4)


@pytest.mark.parametrize(("channel", "order"), [(1, (1, 0)), (2, (0, 1))])
def test_gradients_are_those_of_opencv(channel, order):
    image = np.random.default_rng(0).random((12, 15)).astype(np.float32)
    expected = cv2.Sobel(image, cv2.CV_32F, *order, ksize=3, scale=4 / 8)[1:-1, 1:-1]
    np.testing.assert_allclose(channels(image)[channel], expected, atol=1e-6)


def test_a_saddle_is_negative_and_a_blob_positive():
    y, x = np.mgrid[-3:4, -3:4].astype(np.float64)
    assert channels(x * x - y * y)[6, 2, 2] < -1 < 1 < channels(-x * x - y * y)[6, 2, 2]
    assert channels(x * y)[6, 2, 2] < -1


def test_nothing_is_infinite_and_gradients_flow():
    image = torch.zeros(1, 1, 8, 8, requires_grad=True)
    out = derivative_channels(image, derivative_filters())
    assert out.shape == (1, CHANNELS, 6, 6)
    out.sum().backward()
    assert image.grad is not None
    assert bool(torch.isfinite(image.grad).all())

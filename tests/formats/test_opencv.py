import cv2
import numpy as np
from textured_scenes import keypoints, texture

from sips_lit.describe.sift import SiftDescriptor
from sips_lit.formats.opencv import opencv_keypoints
from sips_lit.types import Keypoints


def test_opencv_has_the_same_points():
    points = keypoints([[1 / 3, 20.1], [30, 7.7777777], [-0.5, 0]], [0.9, 0.1, 1e-7], 2**0.5)
    found = points.to_opencv(10)
    np.testing.assert_array_equal(cv2.KeyPoint.convert(found), points.xy)
    np.testing.assert_array_equal(np.array([point.response for point in found], np.float32), points.score)
    np.testing.assert_allclose([point.size for point in found], 10 * 2**0.5, rtol=1e-6)
    assert {point.angle for point in found} == {0}
    assert Keypoints.empty().to_opencv() == []


def test_the_function_gives_the_same_as_the_method():
    points = keypoints([[3, 4], [5, 6.5]])
    for diameter in ((), (5,)):
        both = zip(opencv_keypoints(points, *diameter), points.to_opencv(*diameter), strict=True)
        assert all((a.pt, a.size, a.response) == (b.pt, b.size, b.response) for a, b in both)


def test_opencv_describes_them_as_we_do():
    image, points = texture(160, 200), keypoints([[80.3, 70.1], [100, 90], [120.7, 75.2]])
    described = cv2.SIFT.create().compute(image, points.to_opencv())[1]
    np.testing.assert_array_equal(described, SiftDescriptor(shrink=1).describe(image, points))

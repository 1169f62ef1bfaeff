import cv2
import numpy as np

from sips_lit.baselines.cv_keypoints import attribute, positions


def test_reading_opencv_points():
    given_points = [cv2.KeyPoint(1.5, 2.25, 7.0, response=0.5), cv2.KeyPoint(3.0, 4.0, 9.0, response=0.25)]
    np.testing.assert_array_equal(positions(given_points), [[1.5, 2.25], [3, 4]])
    np.testing.assert_array_equal(attribute(given_points, "size"), [7, 9])
    np.testing.assert_array_equal(attribute(given_points, "response"), [0.5, 0.25])
    assert positions([]).shape == (0, 2)
    assert attribute([], "size").shape == (0,)

import cv2
import numpy as np

from sips_lit.describe.orb import OrbDescriptor
from sips_lit.types import Keypoints


def test_inside_it_is_opencv_at_angle_zero():
    noise = np.random.default_rng(0).integers(0, 255, (200, 240)).astype(np.uint8)
    image = cv2.GaussianBlur(noise, (0, 0), 2)
    xy = np.random.default_rng(1).integers(60, 140, (30, 2)).astype(np.float32)
    points = [cv2.KeyPoint(float(x), float(y), 31, angle=0) for x, y in xy]
    kept, expected = cv2.ORB_create().compute(image, points)
    assert len(kept) == 30
    ones = np.ones(30, np.float32)
    np.testing.assert_array_equal(OrbDescriptor().describe(image, Keypoints(xy, ones, ones)), expected)

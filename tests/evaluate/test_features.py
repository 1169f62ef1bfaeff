import numpy as np
import pytest
from textured_scenes import keypoints, texture

from sips_lit.describe.orb import OrbDescriptor
from sips_lit.errors import BadInputError
from sips_lit.evaluate.features import extract
from sips_lit.types import Features

IMAGE = texture(120, 160)


class Diagonal:
    """Points on a diagonal, with descriptors of its own or without."""

    name = "Diagonal"

    def __init__(self, describes: bool) -> None:
        self.describes = describes

    def detect(self, image, n):
        return keypoints([[40 + 5 * i, 40 + 3 * i] for i in range(min(n, 12))])

    def detect_and_describe(self, image, n):
        points = self.detect(image, n)
        return Features(points, np.arange(2 * len(points), dtype=np.float32).reshape(-1, 2), "l2")


@pytest.mark.parametrize("describes", [True, False])
@pytest.mark.parametrize("n", [0, 7, 99])
def test_a_given_descriptor_describes_the_points(describes, n):
    features = extract(Diagonal(describes), OrbDescriptor(), IMAGE, n)
    points = Diagonal(describes).detect(IMAGE, n)
    np.testing.assert_array_equal(features.keypoints.xy, points.xy)
    np.testing.assert_array_equal(features.descriptors, OrbDescriptor().describe(IMAGE, points))
    assert features.norm == "hamming"
    assert len(features) == min(n, 12)


def test_without_one_the_detector_describes():
    features = extract(Diagonal(True), None, IMAGE, 5)
    np.testing.assert_array_equal(features.descriptors, np.arange(10).reshape(5, 2))
    assert features.norm == "l2"


def test_without_any_descriptor():
    with pytest.raises(BadInputError, match="Diagonal finds points but does not describe them: choose descriptor="):
        extract(Diagonal(False), None, IMAGE, 5)

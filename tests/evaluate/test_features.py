import numpy as np
import pytest
from textured_scenes import keypoints, texture

from sips_lit.describe.orb import OrbDescriptor
from sips_lit.detect.base import BaseDetector
from sips_lit.errors import BadInputError
from sips_lit.evaluate.features import extract, with_depth
from sips_lit.geometry.projection import View
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.types import Camera, Features, Keypoints

IMAGE = texture(120, 160)


class Diagonal(BaseDetector):
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
    features = extract(Diagonal(describes), OrbDescriptor(), IMAGE, n).features
    points = Diagonal(describes).detect(IMAGE, n)
    np.testing.assert_array_equal(features.keypoints.xy, points.xy)
    np.testing.assert_array_equal(features.descriptors, OrbDescriptor().describe(IMAGE, points))
    assert features.norm == "hamming"
    assert len(features) == min(n, 12)


def test_without_one_the_detector_describes():
    features = extract(Diagonal(True), None, IMAGE, 5).features
    np.testing.assert_array_equal(features.descriptors, np.arange(10).reshape(5, 2))
    assert features.norm == "l2"


def test_without_any_descriptor():
    with pytest.raises(BadInputError, match="Diagonal finds points but does not describe them: choose descriptor="):
        extract(Diagonal(False), None, IMAGE, 5)


class Careless(Diagonal):
    """Adds a point without a place and one outside, and turns the order round."""

    def detect(self, image, n):
        good = super().detect(image, n)
        xy = np.concatenate([[[np.nan, 3], [-9, 4]], good.xy]).astype(np.float32)
        score = np.concatenate([[2, 2], good.score]).astype(np.float32)
        return Keypoints(xy[::-1], score[::-1], np.ones(len(xy), np.float32))


@pytest.mark.parametrize("descriptor", [OrbDescriptor(), None], ids=["given", "own"])
def test_what_a_detector_returns_is_sanitised(descriptor):
    found, good = extract(Careless(True), descriptor, IMAGE, 6), extract(Diagonal(True), descriptor, IMAGE, 6)
    np.testing.assert_array_equal(found.features.keypoints.xy, good.features.keypoints.xy)
    assert (found.defects.invalid, found.defects.outside, found.defects.unsorted) == (1, 1, 1)
    assert str(good.defects) == ""
    assert set(found.milliseconds) == ({"detect"} if descriptor is None else {"detect", "describe"})


def test_depth_of_the_points():
    depth = np.arange(120 * 160, dtype=np.float32).reshape(120, 160)
    found = extract(Diagonal(True), None, IMAGE, 6)
    view = View(IMAGE, Camera(np.eye(3), (160, 120)), depth, None, None)
    measured = with_depth(found, view, StereoMatcher())
    xy = found.features.keypoints.xy.astype(int)
    np.testing.assert_allclose(measured.features.keypoints.depth, depth[xy[:, 1], xy[:, 0]])
    assert set(measured.milliseconds) == {"detect", "depth"}
    assert measured.features.best(2).keypoints.depth.shape == (2,)
    blind = View(IMAGE, Camera(np.eye(3), (160, 120)), None, None, None)
    assert with_depth(found, None, StereoMatcher()) is with_depth(found, blind, StereoMatcher()) is found

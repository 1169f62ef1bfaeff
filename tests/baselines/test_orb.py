import cv2
import numpy as np
import pytest
from detector_contract import scene

from sips_lit.baselines.orb import OrbDetector


def test_points_of_a_level_are_those_of_the_shrunk_image():
    """The level is made here and searched alone; its points go to the image by the rule of pixel centres."""
    image = scene(203, 264)
    size = (round(264 / 1.2), round(203 / 1.2))
    level = cv2.resize(image, size, interpolation=cv2.INTER_LINEAR_EXACT)
    alone = cv2.ORB.create(nfeatures=10_000, nlevels=1, fastThreshold=7).detect(level, None)
    ours = OrbDetector().detect(image, 40_000)
    mine = ours.xy[np.isclose(ours.scale, 1.2)]
    expected = (np.array([p.pt for p in alone]) + 0.5) * [264 / size[0], 203 / size[1]] - 0.5
    assert len(expected) > 30
    for a, b in ((mine, expected), (expected, mine)):
        np.testing.assert_allclose(np.abs(a[:, None] - b).max(axis=2).min(axis=1), 0, atol=1e-3)


def test_features_are_opencv_s():
    image = scene(203, 264)
    features = OrbDetector().detect_and_describe(image, 150)
    points, rows = cv2.ORB.create(nfeatures=150, fastThreshold=7).detectAndCompute(image, None)
    known = {
        (np.float32(p.response), round(1.2**p.octave, 4), row.tobytes()) for p, row in zip(points, rows, strict=True)
    }
    k = features.keypoints
    ours = [
        (score, round(float(scale), 4), row.tobytes())
        for score, scale, row in zip(k.score, k.scale, features.descriptors, strict=True)
    ]
    assert set(ours) == known
    on_full = {tuple(xy) for xy in k.xy[k.scale == 1].tolist()}
    assert on_full == {p.pt for p in points if p.octave == 0}  # nothing is moved at full resolution


def test_no_points_near_the_border():
    found = OrbDetector().detect(scene(203, 264), 40_000)
    margin = np.minimum(found.xy, np.array([263, 202]) - found.xy).min(axis=1)
    assert (margin >= 30 * found.scale).all()
    assert (margin[found.scale == 1] < 40).any()


@pytest.mark.parametrize("size", [(62, 300), (300, 62)])
def test_images_no_larger_than_the_margins_have_no_points(size):
    assert len(OrbDetector().detect(scene(*size), 10)) == 0


def test_dull_images_have_points():
    dull = (scene(203, 264) // 8 + 100).astype(np.uint8)
    assert len(OrbDetector().detect(dull, 1000)) > len(OrbDetector(fast_threshold=20).detect(dull, 1000))

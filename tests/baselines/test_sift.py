import cv2
import numpy as np
import pytest

from sips_lit.baselines.sift import SiftDetector


def blob(x, y, sigma):
    v, u = np.mgrid[:240, :320]
    return (60 + 150 * np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * sigma**2))).round().astype(np.uint8)


@pytest.mark.parametrize("sigma", [1.5, 2.5, 4, 8, 16])
@pytest.mark.parametrize("centre", [(160.0, 120.0), (160.3, 120.7), (91.5, 77.5)])
def test_a_blob_is_found_where_it_is(centre, sigma):
    keypoints = SiftDetector().detect(blob(*centre, sigma), 50)
    np.testing.assert_allclose(keypoints.xy[0], centre, atol=0.12)


def test_scale_follows_the_blob():
    fine, coarse = (SiftDetector().detect(blob(160, 120, sigma), 1).scale[0] for sigma in (6, 12))
    assert coarse / fine == pytest.approx(2, rel=0.05)
    assert SiftDetector().detect(blob(160, 120, 1.5), 1).scale[0] == 1


def test_detection_counts_a_point_once_where_features_have_two_orientations():
    noise = np.random.default_rng(0).integers(0, 255, (200, 200)).astype(np.uint8)
    image = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX)
    features = SiftDetector().detect_and_describe(image, 10_000)
    different = np.unique(np.column_stack([features.keypoints.xy, features.keypoints.scale]), axis=0)
    assert len(different) < len(features)
    assert len(SiftDetector().detect(image, 10_000)) == pytest.approx(len(different), abs=3)


def test_features_are_opencv_s():
    noise = np.random.default_rng(0).integers(0, 255, (200, 200)).astype(np.uint8)
    image = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX)
    features = SiftDetector().detect_and_describe(image, 60)
    points, rows = cv2.SIFT_create(contrastThreshold=0.01, enable_precise_upscale=True).detectAndCompute(image, None)
    of_point = {(p.pt, p.response, tuple(row)) for p, row in zip(points, rows, strict=True)}
    k = features.keypoints
    for xy, score, row in zip(k.xy, k.score, features.descriptors, strict=True):
        assert (tuple(xy.tolist()), float(score), tuple(row)) in of_point
    assert k.score[-1] >= np.sort([p.response for p in points])[-60]

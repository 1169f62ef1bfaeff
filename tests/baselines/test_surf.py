import cv2
import numpy as np
import pytest

pytest.importorskip("mahotas", reason="mahotas is missing: pip install 'sips_lit[surf]'")

from detector_contract import inlier_rate_of_shift, scene

from sips_lit.baselines.sift import SiftDetector
from sips_lit.baselines.surf import SurfDetector


def blob(x, y, sigma):
    v, u = np.mgrid[:240, :320]
    return (60 + 150 * np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * sigma**2))).round().astype(np.uint8)


@pytest.mark.parametrize("sigma", [3, 4, 6, 8])
@pytest.mark.parametrize("centre", [(160.0, 120.0), (160.3, 120.7), (141.6, 97.2)])
def test_a_blob_is_found_where_it_is_and_as_large(centre, sigma):
    """mahotas itself would be up to half a step off: it steps away from the peak. Should it be mended, this fails."""
    image = blob(*centre, sigma)
    best, sift = SurfDetector().detect(image, 1), SiftDetector().detect(image, 1)
    np.testing.assert_allclose(best.xy[0], centre, atol=0.15)
    assert best.scale[0] == pytest.approx(sift.scale[0], rel=0.12)


def test_every_point_is_described_once_up_to_the_border():
    image = scene(150, 190)
    features = SurfDetector().detect_and_describe(image, 10_000)
    x, y = features.keypoints.xy.T
    assert (
        max(x.min(), y.min(), 189 - x.max(), 149 - y.max()) < 5
    )  # mahotas alone finds nothing within 24 px of the border
    assert features.descriptors.shape == (len(features), 64)
    np.testing.assert_allclose(np.linalg.norm(features.descriptors, axis=1), 1, atol=1e-4)
    np.testing.assert_array_equal(SurfDetector().detect(image, 10_000).xy, features.keypoints.xy)
    assert len(np.unique(np.column_stack([features.keypoints.xy, features.keypoints.scale]), axis=0)) == len(features)


def test_best_first_and_fewer_are_the_best_of_more():
    image = scene(150, 190)
    more, fewer = SurfDetector().detect_and_describe(image, 60), SurfDetector().detect_and_describe(image, 20)
    assert len(more) == 60
    assert (np.diff(more.keypoints.score) <= 0).all()
    assert (more.keypoints.scale >= 1).all()
    np.testing.assert_array_equal(more.keypoints.xy[:20], fewer.keypoints.xy)
    np.testing.assert_allclose(more.descriptors[:20], fewer.descriptors, atol=1e-5)
    assert ((more.keypoints.xy >= -0.5) & (more.keypoints.xy <= (189.5, 149.5))).all()


def test_threshold_drops_the_weakest_only():
    image = scene(150, 190)
    all_points, strong = SurfDetector().detect(image, 10_000), SurfDetector(threshold=100).detect(image, 10_000)
    assert 0 < len(strong) < len(all_points)
    np.testing.assert_array_equal(strong.xy, all_points.xy[: len(strong)])
    assert strong.score.min() >= 100 > all_points.score[len(strong)]


@pytest.mark.parametrize("shape", [(1, 1), (5, 4), (1, 300), (60, 70)])
@pytest.mark.parametrize("n", [-1, 0, 5])
def test_images_without_blobs(shape, n):
    features = SurfDetector().detect_and_describe(np.full(shape, 128, np.uint8), n)
    assert features.descriptors.shape == (0, 64)
    assert len(SurfDetector().detect(scene(64, 64), min(n, 0))) == 0


def test_no_offset():
    """Points of an image turned by 180 degrees, turned back, lie on those of the image."""
    image = cv2.resize(scene(200, 240), (241, 201))
    here, there = (
        SurfDetector().detect(image, 2000).xy,
        SurfDetector().detect(np.ascontiguousarray(image[::-1, ::-1]), 2000).xy,
    )
    apart = here[:, None] - ((240, 200) - there)
    error = apart[np.arange(len(here)), np.abs(apart).sum(axis=2).argmin(axis=1)]
    assert np.abs(np.median(error, axis=0)).max() < 0.02
    assert (np.abs(error).max(axis=1) < 0.5).mean() > 0.7


def test_features_match_shifted_crops():
    assert inlier_rate_of_shift(SurfDetector(), scene(180, 220), dx=11, dy=7) > 0.6

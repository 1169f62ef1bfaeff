"""What every baseline promises."""

import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest

from sips_lit.baselines.controls import GridPoints, RandomPoints
from sips_lit.baselines.fast import Fast
from sips_lit.baselines.harris import Harris
from sips_lit.baselines.orb import OrbDetector
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.baselines.sift import SiftDetector

ALL = [SiftDetector, OrbDetector, Fast, ShiTomasi, Harris, RandomPoints, GridPoints]
SEEING = ALL[:5]


@pytest.fixture(scope="module")
def image():
    noise = np.random.default_rng(0).integers(0, 255, (240, 321)).astype(np.uint8)
    blurred = cv2.GaussianBlur(noise, (0, 0), 2).astype(float)
    return np.clip((blurred - blurred.mean()) * 5 + 127, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("kind", ALL)
@pytest.mark.parametrize("n", [1, 7, 100])
def test_at_most_n_inside_sorted(kind, n, image):
    keypoints = kind().detect(image, n)
    assert len(keypoints) == n  # the image has more than enough of everything
    assert keypoints.xy.shape == (n, 2)
    assert keypoints.xy.dtype == keypoints.score.dtype == keypoints.scale.dtype == np.float32
    assert ((keypoints.xy >= -0.5) & (keypoints.xy < np.array([320.5, 239.5]))).all()
    assert (keypoints.scale >= 1).all()
    order = [(-score, y, x) for score, (x, y) in zip(keypoints.score, keypoints.xy, strict=True)]
    assert order == sorted(order)


@pytest.mark.parametrize("kind", ALL)
def test_points_differ(kind, image):
    keypoints = kind().detect(image, 200)
    assert len(np.unique(np.column_stack([keypoints.xy, keypoints.scale]), axis=0)) == len(keypoints)


@pytest.mark.parametrize("kind", [SiftDetector, Fast, ShiTomasi, Harris, RandomPoints])
def test_fewer_are_the_best_of_more(kind, image):
    more, fewer = kind().detect(image, 120), kind().detect(image, 30)
    np.testing.assert_array_equal(fewer.xy, more.xy[:30])


@pytest.mark.parametrize("kind", ALL)
def test_repeatable_and_picklable(kind, image):
    first, again = kind().detect(image, 50), pickle.loads(pickle.dumps(kind())).detect(image.copy(), 50)
    np.testing.assert_array_equal(first.xy, again.xy)
    np.testing.assert_array_equal(first.score, again.score)


@pytest.mark.parametrize("kind", ALL)
@pytest.mark.parametrize("n", [0, -1])
def test_nothing_asked_nothing_given(kind, n, image):
    assert len(kind().detect(image, n)) == 0
    if kind().describes:
        features = kind().detect_and_describe(image, n)
        assert len(features) == len(features.descriptors) == 0


@pytest.mark.parametrize("kind", SEEING)
@pytest.mark.parametrize("shape", [(100, 120), (1, 1), (1, 300), (40, 3), (70, 70)])
@pytest.mark.parametrize("value", [0, 128, 255])
def test_constant_images_have_no_points(kind, shape, value):
    image = np.full(shape, value, np.uint8)
    assert len(kind().detect(image, 10)) == 0
    if kind().describes:
        features = kind().detect_and_describe(image, 10)
        assert len(features) == 0
        assert features.descriptors.shape == (0, 128 if kind is SiftDetector else 32)


@pytest.mark.parametrize("kind", ALL)
@pytest.mark.parametrize("shape", [(1, 1), (5, 4), (1, 300), (64, 64)])
def test_tiny_images_are_legal(kind, shape):
    image = np.random.default_rng(0).integers(0, 255, shape).astype(np.uint8)
    keypoints = kind().detect(image, 5)
    assert len(keypoints) <= 5
    assert ((keypoints.xy >= -0.5) & (keypoints.xy < np.array(shape[::-1]) - 0.5)).all()


@pytest.mark.parametrize("kind", [Fast, ShiTomasi, Harris, RandomPoints, GridPoints])
def test_without_a_descriptor_it_does_not_describe(kind, image):
    assert not kind.describes
    with pytest.raises(TypeError, match=kind.name):
        kind().detect_and_describe(image, 10)


@pytest.mark.parametrize(("kind", "norm", "dimension"), [(SiftDetector, "l2", 128), (OrbDetector, "hamming", 32)])
def test_own_features_match_a_turned_image(kind, norm, dimension, image):
    """Turned by 90 degrees, the points move with the picture and mutual nearest neighbours find them."""
    here, there = (
        kind().detect_and_describe(picture, 150) for picture in (image, np.ascontiguousarray(np.rot90(image)))
    )
    assert here.norm == norm
    assert here.descriptors.shape == (150, dimension)
    rows = [
        np.unpackbits(f.descriptors, axis=1).astype(float) if norm == "hamming" else f.descriptors
        for f in (here, there)
    ]
    apart = np.linalg.norm(rows[0][:, None] - rows[1], axis=2)
    forth, back = apart.argmin(axis=1), apart.argmin(axis=0)
    mutual = np.flatnonzero(back[forth] == np.arange(150))
    expected = np.column_stack([here.keypoints.xy[:, 1], image.shape[1] - 1 - here.keypoints.xy[:, 0]])
    error = np.linalg.norm(there.keypoints.xy[forth[mutual]] - expected[mutual], axis=1)
    assert (error < 2).sum() > 75


@pytest.mark.parametrize("kind", SEEING)
@pytest.mark.parametrize("size", [(240, 320), (231, 317)])
def test_no_offset(kind, size, image):
    """Points of an image turned by 180 degrees, turned back, lie on those of the image: no direction is preferred."""
    image = np.ascontiguousarray(cv2.resize(image, size[::-1]))
    turned = np.ascontiguousarray(image[::-1, ::-1])
    here, there = kind().detect(image, 1000), kind().detect(turned, 1000)
    back = np.array([size[1] - 1, size[0] - 1]) - there.xy
    for level in np.unique(np.rint(np.log2(here.scale))):
        mine, other = (np.rint(np.log2(k.scale)) == level for k in (here, there))
        if mine.sum() < 20 or other.sum() < 20:
            continue
        apart = here.xy[mine][:, None] - back[other]
        nearest = np.abs(apart).sum(axis=2).argmin(axis=1)
        errors = apart[np.arange(len(nearest)), nearest]
        assert np.abs(np.median(errors, axis=0)).max() < 0.02


@pytest.mark.shared_data
def test_real_images_give_enough_points():
    files = sorted((Path(__file__).parents[3] / "shared/data/rgbd_desk/color").glob("*"))
    if not files:
        pytest.skip("the real sequence ../shared/data/rgbd_desk is not there")
    frame = cv2.imread(str(files[0]), cv2.IMREAD_GRAYSCALE)
    for kind in ALL:
        assert len(kind().detect(frame, 500)) == 500

"""What the learned baselines promise, whatever their weights."""

import pickle

import cv2
import numpy as np
import pytest

SHAPES = [(1, 1), (5, 4), (1, 90), (33, 70)]


def scene(height: int, width: int, seed: int = 0):
    noise = np.random.default_rng(seed).integers(0, 255, (height, width)).astype(np.uint8)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX)


def check_contract(detector, dimension: int | None) -> None:
    """Legal points of images of any size; ``dimension`` of the descriptors, None if there are none."""
    assert detector.describes == (dimension is not None)
    for shape in SHAPES:
        for image in (scene(*shape) if min(shape) > 1 else np.full(shape, 9, np.uint8), np.full(shape, 128, np.uint8)):
            _check_image(detector, image, dimension)
    image = scene(97, 131)
    more, fewer = detector.detect(image, 60), detector.detect(image, 20)
    assert len(detector.detect(image, -1)) == 0
    assert len(more) >= 20
    np.testing.assert_array_equal(more.xy[:20], fewer.xy)
    again = pickle.loads(pickle.dumps(detector)).detect(image.copy(), 20)
    np.testing.assert_array_equal(again.xy, fewer.xy)


def _check_image(detector, image, dimension) -> None:
    for n in (0, 7):
        keypoints = detector.detect(image, n)
        assert len(keypoints) <= max(n, 0)
        assert keypoints.xy.shape == (len(keypoints), 2)
        assert keypoints.xy.dtype == keypoints.score.dtype == keypoints.scale.dtype == np.float32
        assert ((keypoints.xy >= -0.5) & (keypoints.xy <= np.array(image.shape[::-1]) - 0.5)).all()
        order = [(-score, y, x) for score, (x, y) in zip(keypoints.score, keypoints.xy, strict=True)]
        assert order == sorted(order)
        assert (keypoints.scale >= 1).all()
        if dimension is None:
            with pytest.raises(TypeError):
                detector.detect_and_describe(image, n)
            continue
        features = detector.detect_and_describe(image, n)
        np.testing.assert_array_equal(features.keypoints.xy, keypoints.xy)
        assert features.descriptors.shape == (len(keypoints), dimension)
        assert (features.descriptors.dtype, features.norm) == (np.float32, "l2")
        np.testing.assert_allclose(np.linalg.norm(features.descriptors, axis=1), 1, atol=1e-4)


def inlier_rate_of_shift(detector, image, dx: int, dy: int, n: int = 100) -> float:
    """How many mutual matches of two overlapping crops of ``image`` are within 1.5 px of the truth, of n points."""
    height, width = image.shape
    here = detector.detect_and_describe(np.ascontiguousarray(image[: height - dy, : width - dx]), n)
    there = detector.detect_and_describe(np.ascontiguousarray(image[dy:, dx:]), n)
    apart = np.linalg.norm(here.descriptors[:, None] - there.descriptors, axis=2)
    forth, back = apart.argmin(axis=1), apart.argmin(axis=0)
    mutual = np.flatnonzero(back[forth] == np.arange(len(here)))
    error = here.keypoints.xy[mutual] - there.keypoints.xy[forth[mutual]] - (dx, dy)
    return float((np.abs(error).max(axis=1) < 1.5).sum() / n)

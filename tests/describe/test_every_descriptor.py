"""What every descriptor promises."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from sips_lit.describe.orb import OrbDescriptor
from sips_lit.describe.sift import RootSift, SiftDescriptor
from sips_lit.describe.surf import SurfDescriptor
from sips_lit.types import Keypoints

DIMENSION = {"SIFT": 128, "RootSIFT": 128, "ORB": 32, "SURF (mahotas)": 64}


@pytest.fixture(params=[SiftDescriptor, RootSift, OrbDescriptor, SurfDescriptor], ids=lambda kind: kind.__name__)
def descriptor(request):
    if request.param is SurfDescriptor:
        pytest.importorskip("mahotas", reason="the extra 'surf' is not installed")
    return request.param()


@pytest.fixture(scope="module")
def image():
    noise = np.random.default_rng(0).integers(0, 255, (120, 160)).astype(np.uint8)
    blurred = cv2.GaussianBlur(noise, (0, 0), 2).astype(float)
    return np.clip((blurred - blurred.mean()) * 5 + 127, 0, 255).astype(np.uint8)


def keypoints_at(xy, scale=1.0):
    xy = np.asarray(xy, np.float32).reshape(-1, 2)
    return Keypoints(xy, np.ones(len(xy), np.float32), np.broadcast_to(np.float32(scale), len(xy)).copy())


def scattered(n, scale=1.0):
    return keypoints_at(np.random.default_rng(1).random((n, 2)) * (159, 119), scale)


def unpacked(descriptor, rows):
    return np.unpackbits(rows, axis=1).astype(float) if descriptor.norm == "hamming" else rows.astype(float)


def distance(descriptor, rows0, rows1):
    """Distances (N0, N1), 0 = equal and about 1 = unrelated."""
    rows0, rows1 = unpacked(descriptor, rows0), unpacked(descriptor, rows1)
    apart = np.linalg.norm(rows0[:, None] - rows1, axis=2)
    return apart / np.linalg.norm(rows1 - np.roll(rows1, 1, axis=0), axis=1).mean()


def test_one_row_each_at_the_border_too(descriptor, image):
    corners = [[0, 0], [159, 0], [0, 119], [159, 119], [-0.5, 119.49], [80, 0], [80, 60]]
    rows = descriptor.describe(image, keypoints_at(corners, [1, 1, 2, 0.5, 1, 7, 30]))
    assert rows.shape == (7, DIMENSION[descriptor.name])
    assert rows.dtype == (np.uint8 if descriptor.norm == "hamming" else np.float32)
    assert (unpacked(descriptor, rows).sum(axis=1) != 0).all()


def test_a_row_belongs_to_its_point_whatever_the_company(descriptor, image):
    scale = np.random.default_rng(2).choice([1, 1.4, 2, 2.9, 4], 40)
    keypoints = scattered(40, scale)
    together = descriptor.describe(image, keypoints)
    alone = [descriptor.describe(image, keypoints_at(keypoints.xy[i], scale[i]))[0] for i in range(40)]
    np.testing.assert_array_equal(together, np.stack(alone))


@pytest.mark.parametrize("scale", [1.0, 1.18, 2.0])
def test_the_border_is_the_edge_repeated(descriptor, image, scale):
    keypoints = scattered(60, scale)
    margin = 120  # even, as the image may be halved
    larger = cv2.copyMakeBorder(image, margin, margin, margin, margin, cv2.BORDER_REPLICATE)
    inside = descriptor.describe(larger, keypoints_at(keypoints.xy + margin, scale))
    np.testing.assert_allclose(
        descriptor.describe(image, keypoints).astype(float),
        inside.astype(float),
        atol=1e-4 if scale < 2 else 0.02 * inside.max(),
    )


def test_shifted_image_shifted_points_match(descriptor, image):
    keypoints = keypoints_at(np.random.default_rng(3).random((40, 2)) * (90, 60) + 30)
    shifted = keypoints_at(keypoints.xy - (7, 4))
    apart = distance(descriptor, descriptor.describe(image, keypoints), descriptor.describe(image[4:, 7:], shifted))
    assert (apart.argmin(axis=1) == np.arange(40)).mean() > 0.9


@pytest.mark.parametrize("scale", [1.5, 2, 5])
def test_support_grows_with_the_scale(descriptor, image, scale):
    """An image `scale` times larger, with points `scale` times larger, looks the same."""
    keypoints = keypoints_at(np.random.default_rng(4).random((40, 2)) * (100, 60) + 30, 1)
    larger = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    enlarged = keypoints_at((keypoints.xy + 0.5) * scale - 0.5, scale)
    here, there = descriptor.describe(image, keypoints), descriptor.describe(larger, enlarged)
    apart = distance(descriptor, here, there)
    assert (apart.argmin(axis=1) == np.arange(40)).mean() > 0.7
    fixed = descriptor.describe(larger, keypoints_at(enlarged.xy, 1))
    assert np.diag(apart).mean() < 0.7 * np.diag(distance(descriptor, here, fixed)).mean()


def test_no_points(descriptor, image):
    rows = descriptor.describe(image, Keypoints.empty())
    assert rows.shape == (0, DIMENSION[descriptor.name])


@pytest.mark.parametrize("value", [0, 77, 255])
def test_constant_images_are_finite(descriptor, value):
    rows = descriptor.describe(
        np.full((50, 60), value, np.uint8), keypoints_at([[0, 0], [30, 20], [59, 49]], [1, 2, 9])
    )
    assert np.isfinite(rows.astype(float)).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 90), (3, 2)])
def test_tiny_images(descriptor, shape):
    image = np.random.default_rng(0).integers(0, 255, shape).astype(np.uint8)
    rows = descriptor.describe(image, keypoints_at([[0, 0], [shape[1] - 1, shape[0] - 1]], [1, 40]))
    assert rows.shape == (2, DIMENSION[descriptor.name])
    assert np.isfinite(rows.astype(float)).all()


def test_many_threads_and_a_pickled_copy_agree(descriptor, image):
    keypoints = scattered(80)
    copy = pickle.loads(pickle.dumps(descriptor))
    with ThreadPoolExecutor(4) as threads:
        answers = list(threads.map(lambda _: copy.describe(image, keypoints), range(8)))
    for rows in answers:
        np.testing.assert_array_equal(rows, descriptor.describe(image, keypoints))


def test_the_image_is_not_touched(descriptor, image):
    before = image.copy()
    descriptor.describe(image, scattered(5))
    np.testing.assert_array_equal(image, before)

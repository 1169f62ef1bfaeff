import cv2
import numpy as np
import pytest

from sips_lit.baselines.harris import Harris
from sips_lit.baselines.shi_tomasi import ShiTomasi


@pytest.fixture(scope="module")
def image():
    noise = np.random.default_rng(0).integers(0, 255, (90, 121)).astype(np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 1.5)


def greedy(response, n, distance):
    """Slow twin: take local maxima, best first, that are far enough from all taken before."""
    inner = [
        (response[y, x], y, x)
        for y in range(1, response.shape[0] - 1)
        for x in range(1, response.shape[1] - 1)
        if response[y, x] > 1e-6 * response.max() and response[y, x] == response[y - 1 : y + 2, x - 1 : x + 2].max()
    ]
    taken: list[tuple[float, int, int]] = []
    for candidate in sorted(inner, reverse=True):
        if all(np.hypot(candidate[1] - y, candidate[2] - x) >= distance for _, y, x in taken):
            taken.append(candidate)
    return taken[:n]


@pytest.mark.parametrize("distance", [2.0, 5.0, 9.0])
@pytest.mark.parametrize("kind", [ShiTomasi, Harris])
def test_strongest_far_enough_apart(kind, distance, image):
    response = (
        cv2.cornerHarris(image, 3, ksize=3, k=0.04) if kind is Harris else cv2.cornerMinEigenVal(image, 3, ksize=3)
    )
    expected = greedy(response, 80, distance)
    keypoints = kind(distance).detect(image, 80)
    np.testing.assert_array_equal(keypoints.xy, [(x, y) for _, y, x in expected])
    np.testing.assert_allclose(keypoints.score, [score for score, *_ in expected], rtol=1e-4)


@pytest.mark.parametrize("kind", [ShiTomasi, Harris])
def test_a_symmetric_corner_is_where_it_is(kind):
    """The corners around the crossing of two thin lines are symmetric about it."""
    image = np.full((101, 101), 40, np.uint8)
    image[50, 20:81] = image[20:81, 50] = 240
    corners = kind(1).detect(image, 50).xy
    near = corners[np.abs(corners - 50).max(axis=1) <= 3]
    assert len(near) >= 1
    np.testing.assert_allclose(near.mean(axis=0), [50, 50], atol=1e-5)


@pytest.mark.parametrize("kind", [ShiTomasi, Harris])
@pytest.mark.parametrize("n", [0, -1])
def test_no_points_asked_for(kind, n, image):
    assert len(kind().detect(image, n)) == 0

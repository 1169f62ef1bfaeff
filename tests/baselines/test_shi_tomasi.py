import cv2
import numpy as np
import pytest
from second_moments import second_moments

from sips_lit.baselines.shi_tomasi import ShiTomasi


def test_the_score_is_the_smaller_eigenvalue():
    noise = np.random.default_rng(0).integers(0, 255, (50, 70)).astype(np.uint8)
    image = cv2.GaussianBlur(noise, (0, 0), 1.5)
    found = ShiTomasi().detect(image, 20)
    inner = np.all((found.xy > 2) & (found.xy < (67, 47)), axis=1)
    assert inner.sum() > 10
    matrices = [second_moments(image, int(x), int(y)) for x, y in found.xy[inner]]
    expected = [np.linalg.eigvalsh(M)[0] for M in matrices]
    np.testing.assert_allclose(found.score[inner], expected, rtol=1e-4)


def test_four_corners_of_a_box_and_none_on_its_edges():
    image = np.full((200, 200), 50, np.uint8)
    image[80:120, 70:140] = 200
    found = ShiTomasi().detect(image, 100)
    assert len(found) == 4
    corners = np.array([[69.5, 79.5], [139.5, 79.5], [69.5, 119.5], [139.5, 119.5]])
    assert np.abs(found.xy[:, None] - corners).max(axis=2).min(axis=0).max() <= 1


@pytest.mark.parametrize(("apart", "count"), [(4, 1), (5, 2)])
def test_points_are_five_pixels_apart_by_default(apart, count):
    image = np.zeros((40, 60), np.uint8)
    image[20, 20] = image[20, 20 + apart] = 255
    peaks = ShiTomasi().detect(image, 100).xy
    near = peaks[(np.abs(peaks[:, 1] - 20) <= 1) & (peaks[:, 0] >= 19) & (peaks[:, 0] <= 21 + apart)]
    assert len(near) == count

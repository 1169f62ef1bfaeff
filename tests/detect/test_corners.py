import cv2
import numpy as np
import pytest
import torch
from textured_scenes import texture

from sips_lit.detect.corners import CELL, USUAL, corner_strength
from sips_lit.detect.selection import image_tensor


def cells_of(image: np.ndarray) -> np.ndarray:
    """The strength of each whole cell that has neighbours, one by one."""
    dy, dx = np.gradient(image.astype(np.float64))  # central differences
    rows, columns = image.shape[0] // CELL, image.shape[1] // CELL
    strength = np.full((rows, columns), np.nan)
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            window = np.s_[CELL * (row - 1) : CELL * (row + 2), CELL * (column - 1) : CELL * (column + 2)]
            x, y = dx[window].ravel(), dy[window].ravel()
            strength[row, column] = np.log(
                1 + np.linalg.eigvalsh(np.array([[x @ x, x @ y], [x @ y, y @ y]]) / len(x))[0]
            )
    return strength - USUAL


@pytest.mark.parametrize("size", [(48, 60), (47, 61)])
def test_strength_is_that_of_the_smaller_eigenvalue_and_linear_between_cells(size):
    image = texture(*size, 2)
    image[:, 30:] = image[:, 30:] // 8 + 100  # texture that is hardly there beside strong one
    cells = cells_of(image)
    expected = cv2.resize(cells, None, fx=CELL, fy=CELL, interpolation=cv2.INTER_LINEAR)
    found = corner_strength(image_tensor(image))
    assert found.shape == (1, 1, *size)
    inner = np.s_[12:28, 12:44]  # of cells that have neighbours on all sides, whose neighbours have them, too
    assert np.ptp(expected[inner]) > 1
    np.testing.assert_allclose(found[0, 0].numpy()[inner], expected[inner], atol=1e-4)


def test_a_corner_is_strong_and_an_edge_is_not():
    image = np.zeros((80, 80), np.uint8)
    image[40:, 40:] = 200
    strength = corner_strength(image_tensor(image))[0, 0] + USUAL
    assert strength[40, 40] > 5
    assert max(strength[72, 40], strength[40, 72], strength[10, 10], strength[70, 70]) < 1e-3


def test_beside_the_last_pixel_the_image_goes_on():
    image = np.tile(np.arange(0, 240, 6, dtype=np.uint8), (37, 1))  # a ramp has no corner at its sides either
    assert corner_strength(image_tensor(image)).max() < -USUAL + 1e-3


@pytest.mark.parametrize("size", [(1, 1), (2, 7), (40, 3)])
def test_small_and_blank_images_have_no_strength(size):
    strength = corner_strength(torch.full((2, 1, *size), 255.0))
    assert strength.shape == (2, 1, *size)
    assert (strength == -USUAL).all()

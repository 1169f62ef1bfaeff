import cv2
import numpy as np
import pytest
import torch
from textured_scenes import texture

from sips_lit.detect.corners import CELL, FINE_CELL, USUAL, corner_strength
from sips_lit.detect.selection import image_tensor

WEIGHTS = {CELL: (1, 0), FINE_CELL: (0, 1)}


def cells_of(image: np.ndarray, cell: int) -> np.ndarray:
    """The strength of each whole cell that has neighbours, one by one."""
    dy, dx = np.gradient(image.astype(np.float64))  # central differences
    rows, columns = image.shape[0] // cell, image.shape[1] // cell
    strength = np.full((rows, columns), np.nan)
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            window = np.s_[cell * (row - 1) : cell * (row + 2), cell * (column - 1) : cell * (column + 2)]
            x, y = dx[window].ravel(), dy[window].ravel()
            strength[row, column] = np.log(
                1 + np.linalg.eigvalsh(np.array([[x @ x, x @ y], [x @ y, y @ y]]) / len(x))[0]
            )
    return strength - USUAL


@pytest.mark.parametrize("cell", [CELL, FINE_CELL])
@pytest.mark.parametrize("size", [(48, 60), (47, 61)])
def test_strength_is_that_of_the_smaller_eigenvalue_and_linear_between_cells(size, cell):
    image = texture(*size, 2)
    image[:, 30:] = image[:, 30:] // 8 + 100  # texture that is hardly there beside strong one
    cells = cells_of(image, cell)
    expected = cv2.resize(cells, None, fx=cell, fy=cell, interpolation=cv2.INTER_LINEAR)
    found = corner_strength(image_tensor(image), *WEIGHTS[cell])
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


@pytest.mark.parametrize("size", [(48, 60), (47, 61), (1, 1), (2, 7)])
def test_both_strengths_add_up_by_their_weights(size):
    image = image_tensor(texture(*size, 2))
    both = 0.75 * corner_strength(image) + 0.5 * corner_strength(image, 0, 1)
    torch.testing.assert_close(corner_strength(image, 0.75, 0.5), both, rtol=0, atol=1e-4)


def test_fine_strength_is_highest_at_the_corner_itself():
    image = np.zeros((80, 80), np.uint8)
    image[41:, 38:] = 200
    fine = corner_strength(image_tensor(image), 0, 1)[0, 0]
    row, column = np.unravel_index(int(fine.argmax()), fine.shape)
    assert abs(row - 41) <= 2
    assert abs(column - 38) <= 2
    assert (fine > -USUAL + 1).sum() < 150 < (corner_strength(image_tensor(image))[0, 0] > -USUAL + 1).sum()


@pytest.mark.parametrize("cell", [CELL, FINE_CELL])
@pytest.mark.parametrize("size", [(1, 1), (2, 7), (40, 3)])
def test_small_and_blank_images_have_no_strength(size, cell):
    strength = corner_strength(torch.full((2, 1, *size), 255.0), *WEIGHTS[cell])
    assert strength.shape == (2, 1, *size)
    assert (strength == -USUAL).all()

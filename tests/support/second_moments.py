"""The second-moment matrix that corner measures are made of, by hand."""

import numpy as np


def second_moments(image: np.ndarray, x: int, y: int) -> np.ndarray:
    """(2, 2): gradients of the 3 x 3 pixels around an inner pixel, Sobel's derivatives scaled as OpenCV does."""
    wide = image.astype(float) / 255
    matrix = np.zeros((2, 2))
    for v in range(y - 1, y + 2):
        for u in range(x - 1, x + 2):
            dx = wide[v - 1 : v + 2, u + 1] - wide[v - 1 : v + 2, u - 1]
            dy = wide[v + 1, u - 1 : u + 2] - wide[v - 1, u - 1 : u + 2]
            gradient = np.array([dx @ [1, 2, 1], dy @ [1, 2, 1]]) / 12  # 2 ^ (3 - 1) x block of 3
            matrix += np.outer(gradient, gradient)
    return matrix

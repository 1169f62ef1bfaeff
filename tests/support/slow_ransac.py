"""RANSAC as in a textbook, by OpenCV's P3P: the slow twin of the pose estimation."""

import cv2
import numpy as np


def most_inliers(
    points: np.ndarray, pixels: np.ndarray, matrix: np.ndarray, samples: int, threshold: float, seed: int = 0
) -> int:
    """The largest number of points (M, 3) that any pose of a random triple projects within ``threshold`` of their pixels."""
    generator = np.random.default_rng(seed)
    best = 0
    for _ in range(samples):
        triple = generator.choice(len(points), 3, replace=False)
        _, rotations, translations = cv2.solveP3P(points[triple], pixels[triple], matrix, None, cv2.SOLVEPNP_AP3P)
        for rotation, translation in zip(rotations, translations, strict=True):
            seen = points @ cv2.Rodrigues(rotation)[0].T + translation.ravel()
            projected = seen @ matrix.T
            errors = np.linalg.norm(projected[:, :2] / projected[:, 2:] - pixels, axis=1)
            best = max(best, int(((errors <= threshold) & (seen[:, 2] > 0)).sum()))
    return best

"""P3P RANSAC of 3000 samples against OpenCV's, which stops early: time, inliers found and error of the pose."""

from __future__ import annotations

import time

import cv2
import numpy as np
from tabulate import tabulate

from sips_lit.geometry.pnp import p3p_ransac
from sips_lit.geometry.pose import rotation_error, translation_error
from sips_lit.types import Camera

CAMERA = Camera(np.array([[700.0, 0, 620], [0, 700, 190], [0, 0, 1]]), (1241, 376))
ITERATIONS, REPEATS = 3000, 5


def scene(count: int, outliers: float, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, their pixels in the second view with half a pixel of noise, and the true motion."""
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(generator.uniform(-0.1, 0.1, 3))[0]
    T[:3, 3] = generator.uniform([-0.5, -0.2, -3], [0.5, 0.2, -0.5])
    seen = np.column_stack([generator.uniform([0, 0], CAMERA.size, (count, 2)), np.ones(count)])
    moved = seen @ np.linalg.inv(CAMERA.matrix).T * generator.uniform(5, 60, (count, 1))
    points = (moved - T[:3, 3]) @ T[:3, :3]
    pixels = seen[:, :2] + generator.normal(0, 0.5, (count, 2))
    wrong = generator.random(count) < outliers
    pixels[wrong] = generator.uniform([0, 0], CAMERA.size, (int(wrong.sum()), 2))
    return points, pixels, T


def opencv(points: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray | None, int]:
    """Pose and number of inliers."""
    found, rotation, translation, inliers = cv2.solvePnPRansac(
        points, pixels, CAMERA.matrix, None, iterationsCount=ITERATIONS, reprojectionError=3.0, flags=cv2.SOLVEPNP_P3P
    )
    if not found:
        return None, 0
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(rotation)[0], translation.ravel()
    return T, len(inliers)


def main() -> None:
    rows = []
    for count, outliers in ((10, 0.3), (30, 0.3), (100, 0.3), (200, 0.3), (200, 0.7), (500, 0.7)):
        ours, theirs = [], []
        for repeat in range(REPEATS):
            points, pixels, T = scene(count, outliers, np.random.default_rng([count, repeat]))
            start = time.perf_counter()
            estimate = p3p_ransac(points, pixels, CAMERA, np.random.default_rng(repeat), ITERATIONS)
            ours.append(row(time.perf_counter() - start, estimate.T_1_0, estimate.inliers, T))
            start = time.perf_counter()
            pose, inliers = opencv(points, pixels)
            theirs.append(row(time.perf_counter() - start, pose, inliers, T))
        rows.append([count, f"{outliers:.0%}", *np.median(ours, 0), *np.median(theirs, 0)])
    columns = ["ms", "inliers", "m", "degrees"]
    headers = ["matches", "outliers", *columns, *(f"OpenCV {column}" for column in columns)]
    print(tabulate(rows, headers=headers, tablefmt="github", floatfmt=".3g"))


def row(seconds: float, pose: np.ndarray | None, inliers: int, truth: np.ndarray) -> tuple[float, float, float, float]:
    if pose is None:
        return 1e3 * seconds, inliers, np.inf, np.inf
    return 1e3 * seconds, inliers, translation_error(pose, truth), rotation_error(pose, truth)


if __name__ == "__main__":
    main()

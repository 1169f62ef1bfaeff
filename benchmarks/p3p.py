"""P3P in RANSAC by PoseLib, as the package uses it, against both RANSACs of OpenCV.

The first table has the time, the inliers and the errors of the pose. The second shows whether a seed changes anything, and
how much longer ten times the iterations take (about once as long where the search stops early). Last, two threads against
one: PoseLib does not hold Python's lock.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
from tabulate import tabulate

from sips_lit.geometry.pnp import p3p_ransac
from sips_lit.geometry.pose import PoseEstimate, rotation_error, translation_error
from sips_lit.types import Camera

CAMERA = Camera(np.array([[700.0, 0, 620], [0, 700, 190], [0, 0, 1]]), (1241, 376))
ITERATIONS, THRESHOLD, REPEATS, SEEDS = 3000, 3.0, 5, 20
Problem = tuple[np.ndarray, np.ndarray, np.ndarray]
Estimator = Callable[[Problem, int, int], PoseEstimate]  # problem, seed, iterations


def scene(count: int, outliers: float, generator: np.random.Generator, noise: float = 0.5) -> Problem:
    """Points, their noisy pixels in the second view, and the true motion."""
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(generator.uniform(-0.1, 0.1, 3))[0]
    T[:3, 3] = generator.uniform([-0.5, -0.2, -3], [0.5, 0.2, -0.5])
    seen = np.column_stack([generator.uniform([0, 0], CAMERA.size, (count, 2)), np.ones(count)])
    moved = seen @ np.linalg.inv(CAMERA.matrix).T * generator.uniform(5, 60, (count, 1))
    points = (moved - T[:3, 3]) @ T[:3, :3]
    pixels = seen[:, :2] + generator.normal(0, noise, (count, 2))
    wrong = generator.random(count) < outliers
    pixels[wrong] = generator.uniform([0, 0], CAMERA.size, (int(wrong.sum()), 2))
    return points, pixels, T


def ours(problem: Problem, seed: int, iterations: int) -> PoseEstimate:
    points, pixels, _ = problem
    return p3p_ransac(points, pixels, CAMERA, np.random.default_rng(seed), iterations, THRESHOLD)


def classic(problem: Problem, seed: int, iterations: int) -> PoseEstimate:
    points, pixels, _ = problem
    cv2.setRNGSeed(seed)
    found, rotation, translation, inliers = cv2.solvePnPRansac(
        points, pixels, CAMERA.matrix, None,
        iterationsCount=iterations, reprojectionError=THRESHOLD, flags=cv2.SOLVEPNP_P3P,
    )  # fmt: skip
    return estimate(found, rotation, translation, inliers, len(points))


def usac(problem: Problem, seed: int, iterations: int) -> PoseEstimate:
    points, pixels, _ = problem
    options = cv2.UsacParams()
    options.maxIterations, options.threshold, options.randomGeneratorState = iterations, THRESHOLD, seed
    found, _, rotation, translation, inliers = cv2.solvePnPRansac(
        points, pixels, CAMERA.matrix.copy(), None, params=options
    )
    return estimate(found, rotation, translation, inliers, len(points))


def estimate(found: bool, rotation: np.ndarray, translation: np.ndarray, agree: np.ndarray, count: int) -> PoseEstimate:
    inlier = np.zeros(count, bool)
    if not found:
        return PoseEstimate(None, inlier)
    inlier[agree.ravel()] = True
    return PoseEstimate(np.block([[cv2.Rodrigues(rotation)[0], translation.reshape(3, 1)], [0, 0, 0, 1]]), inlier)


def timed(estimator: Estimator, problem: Problem, seed: int, iterations: int) -> tuple[float, PoseEstimate]:
    start = time.perf_counter()
    found = estimator(problem, seed, iterations)
    return 1e3 * (time.perf_counter() - start), found


def row(estimator: Estimator, count: int, outliers: float) -> list[float]:
    """Medians of milliseconds, inliers, metres and degrees."""
    numbers = []
    for repeat in range(REPEATS):
        problem = scene(count, outliers, np.random.default_rng([count, repeat]))
        milliseconds, found = timed(estimator, problem, repeat, ITERATIONS)
        T = found.T_1_0
        errors = (np.inf, np.inf) if T is None else (translation_error(T, problem[2]), rotation_error(T, problem[2]))
        numbers.append([milliseconds, found.inliers, *errors])
    return list(np.median(numbers, 0))


def seeds_and_stops(estimator: Estimator) -> list[object]:
    """Different poses for the seeds and for one seed; how much longer ten times the iterations take."""
    problem = scene(100, 0.6, np.random.default_rng(3), noise=1.5)
    poses = [estimator(problem, seed, ITERATIONS).T_1_0 for seed in (*range(SEEDS), *[7] * SEEDS)]
    keys = ["" if T is None else T.tobytes() for T in poses]
    short, long = (
        np.median([timed(estimator, problem, seed, iterations)[0] for seed in range(SEEDS)])
        for iterations in (ITERATIONS, 10 * ITERATIONS)
    )
    return [len(set(keys[:SEEDS])), len(set(keys[SEEDS:])), long / short]


def threads_speed_up() -> float:
    """Wall time of one thread over that of two, the median of several rounds."""
    problems = [scene(300, 0.4, np.random.default_rng(at)) for at in range(40)]
    ratios = []
    with ThreadPoolExecutor(2) as threads:
        for _ in range(7):
            start = time.perf_counter()
            for problem in problems:
                ours(problem, 0, ITERATIONS)
            middle = time.perf_counter()
            list(threads.map(lambda problem: ours(problem, 0, ITERATIONS), problems))
            ratios.append((middle - start) / (time.perf_counter() - middle))
    return float(np.median(ratios))


def main() -> None:
    estimators = {"PoseLib": ours, "OpenCV": classic, "OpenCV, UsacParams": usac}
    cases = ((10, 0.3), (30, 0.3), (100, 0.3), (200, 0.3), (200, 0.7), (500, 0.7))
    rows = [
        [count, f"{outliers:.0%}", name, *row(each, count, outliers)]
        for count, outliers in cases
        for name, each in estimators.items()
    ]
    headers = ["matches", "outliers", "by", "ms", "inliers", "m", "degrees"]
    print(tabulate(rows, headers=headers, tablefmt="github", floatfmt=".3g"), end="\n\n")
    headers = ["by", f"poses of {SEEDS} seeds", "of one seed", "time of 10 x iterations / time"]
    rows = [[name, *seeds_and_stops(each)] for name, each in estimators.items()]
    print(tabulate(rows, headers=headers, tablefmt="github", floatfmt=".3g"), end="\n\n")
    print(f"PoseLib, two threads against one: {threads_speed_up():.2f} times as fast")


if __name__ == "__main__":
    main()

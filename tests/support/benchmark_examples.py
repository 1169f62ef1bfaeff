"""Plausible records of benchmarks, drawn from a seeded generator."""

from collections.abc import Sequence

import numpy as np

from sips_lit.evaluate.result import AtBudget, MethodResult, PairSetResult, PairTable, PoseOutcome
from sips_lit.metrics.calibration import CalibrationResult, bin_sums, summarise

KS = (5, 6, 7, 8, 10, 12, 15, 20, 25, 30)
NAMES = (
    "SIPs",
    "SIFT",
    "ORB",
    "FAST",
    "Shi-Tomasi",
    "Harris",
    "SURF (mahotas)",
    "ALIKED-t16",
    "DISK",
    "XFeat",
    "KeyNet",
)


def pair_table(generator: np.random.Generator, pairs: int, poses: bool = True) -> PairTable:
    translation = generator.gamma(2.0, 0.9, pairs)
    rotation = generator.gamma(1.2, 2.0, pairs)
    unknown = np.full(pairs, np.nan)
    return PairTable(
        tuple(f"drive_{10 * i:06d}_{10 * i + 7:06d}" for i in range(pairs)),
        generator.uniform(0.5, 0.95, pairs),
        np.full(pairs, 7.0),
        unknown,
        rotation if poses else unknown,
        translation if poses else unknown,
    )


def calibration(generator: np.random.Generator, points: int) -> CalibrationResult:
    score = generator.beta(3, 2, points)
    return summarise(bin_sums(score, generator.random(points) < score**1.1, 20))


def at_budget(generator, n: int, table: PairTable, n_k10: np.ndarray, error: float) -> AtBudget:
    pairs, repeats = n_k10.shape
    failed = n_k10 > n
    known = ~np.isnan(table.translation)[:, None]
    errors = [np.where(failed, np.inf, generator.gamma(1.2, scale, (pairs, repeats))) for scale in (error, error * 0.8)]
    inliers = np.minimum((10 * n / np.minimum(n_k10, 10_000)).astype(np.int64), n)
    return AtBudget(
        n,
        inliers[:, 0] + generator.integers(0, 5, pairs),
        inliers,
        np.where(known, errors[0], np.nan),
        np.where(known, errors[1], np.nan),
        np.where(known, np.where(failed, PoseOutcome.FEW_INLIERS, PoseOutcome.FOUND), PoseOutcome.UNKNOWN),
        generator.uniform(0.3, 0.7, pairs),
        generator.uniform(0.2, 0.5, pairs),
        generator.uniform(0.1, 0.4, pairs),
    )


def detector_result(
    name: str,
    table: PairTable,
    seed: int = 0,
    quality: float = 0.7,
    repeats: int = 5,
    n_max: int = 200,
    probabilities: bool = False,
    key: str | None = None,
) -> MethodResult:
    generator = np.random.default_rng(seed)
    pairs = len(table)
    excess = generator.gamma(1.3, 40 * (1.05 - quality), (pairs, 1)) + generator.random((pairs, repeats)) * 3
    ks = np.array(KS)
    n_k = np.ceil(ks * (1 + excess[:, :, None] / 10) + 0.001 * ks**2 * excess[:, :, None])
    n_k[n_k > n_max] = np.inf
    errors = generator.gamma(1.2, 0.5, n_k.shape) * (1.2 - quality)
    errors = np.where(np.isfinite(n_k), errors, np.inf)
    errors[np.isnan(table.translation)] = np.nan
    base, _, descriptor = name.partition(" + ")
    return MethodResult(
        key or name.lower().replace(" + ", "_").replace(" ", "_"),
        name,
        {
            "detector": base,
            "descriptor": descriptor or "own",
            "k": 10,
            "n": 50,
            "n_max": n_max,
            "search": "binary",
            "versions": {"numpy": "2", "opencv": "5"},
        },
        table,
        KS,
        n_max,
        n_k,
        n_k,
        np.zeros(pairs),
        errors * 0.8,
        errors,
        generator.integers(150, n_max + 1, pairs),
        generator.integers(150, n_max + 1, pairs),
        {n: at_budget(generator, n, table, n_k[:, :, KS.index(10)], 0.5 * (1.3 - quality)) for n in (50, 100)},
        {n: calibration(generator, n * max(pairs, 1)) for n in (50, 500)} if probabilities else {},
        {"detect": generator.uniform(2, 80), "describe": 12.5, "match": 1.5, "verify": 40.0},
        {"images": 2 * pairs, "returned": 400 * pairs, "duplicates": 3, "outside": 0},
    )


def pair_set(
    names: Sequence[str] = NAMES, pairs: int = 100, poses: bool = True, key: str = "kitti", repeats: int = 5
) -> PairSetResult:
    """Every detector with RootSIFT, half of them with their own descriptor as well, and the controls."""
    table = pair_table(np.random.default_rng(len(key)), pairs, poses)
    detectors = []
    for index, name in enumerate(names):
        quality = 0.95 - 0.06 * index
        detectors.append(
            detector_result(f"{name} + RootSIFT", table, index, quality, repeats, probabilities=index == 0)
        )
        if index % 2:
            detectors.append(detector_result(name, table, 100 + index, quality - 0.05, repeats))
    for index, name in enumerate(("random", "grid")):
        detectors.append(detector_result(f"{name} + RootSIFT", table, 200 + index, -3.0, repeats))
    protocol = {
        "sequences": ["drive"],
        "pairs": pairs,
        "overlap": 0.5,
        "seed": 0,
        "k": 10,
        "image_size": [1241, 376],
        "verification": [{"inliers": "stereo_p3p", "threshold": 3.0, "iterations": 3000}],
    }
    skipped = {"superpoint": "superpoint.pth is missing: download it from the authors, and set detector.path."}
    return PairSetResult(key, "KITTI odometry 00", protocol, tuple(detectors), skipped)

"""Results in which every number is different, so that none can stand in another's place unnoticed."""

import itertools
import math

import numpy as np

from sips_lit.evaluate.result import AtBudget, MethodResult, PairSetResult, PairTable, PoseOutcome
from sips_lit.metrics.calibration import CalibrationResult

PAIRS, REPEATS, KS, N_MAX, BUDGETS, CALIBRATED = 6, 4, (4, 7, 12), 90, (20, 60), (30, 80)
K, N, METRES, DEGREES = 7, 60, 0.5, 2.0  # of the table: neither the paper's nor the first
STAGES = ("detect", "describe", "match", "verify")
DEFECTS = ("images", "returned", "duplicates", "outside")


class Fresh:
    """Numbers that were never given before: whole ones by counting, others from a generator."""

    def __init__(self) -> None:
        self.whole, self.generator = itertools.count(1000, 7), np.random.default_rng(7)

    def counts(self, *shape: int) -> np.ndarray:
        return np.array([next(self.whole) for _ in range(math.prod(shape))], np.int64).reshape(shape)

    def floats(self, *shape: int, scale: float = 1.0) -> np.ndarray:
        return self.generator.uniform(0.05, 1.0, shape) * scale


def at_budget(fresh: Fresh, n: int, table: PairTable, turn: int) -> AtBudget:
    """Errors around the limits; one pair without a true pose, one pair that failed once. Outcomes as often as no other."""
    rotation = fresh.floats(PAIRS, REPEATS, scale=1.4 * DEGREES)
    translation = fresh.floats(PAIRS, REPEATS, scale=1.7 * METRES)
    for errors in (rotation, translation):
        errors[np.isnan(table.rotation)] = np.nan
        errors[1, turn % REPEATS] = np.inf
    kinds = [
        kind
        for kind, often in zip(_turned(list(PoseOutcome), turn), (7, 6, 5, 4, 2), strict=True)
        for _ in range(often)
    ]
    outcome = np.random.default_rng(turn).permutation(np.array(kinds, np.int64)).reshape(PAIRS, REPEATS)
    repeatability = fresh.floats(PAIRS)
    repeatability[turn % PAIRS] = np.nan
    matches, inliers = fresh.counts(PAIRS), fresh.counts(PAIRS, REPEATS)
    return AtBudget(
        n=n,
        matches=matches,
        inliers=inliers,
        rotation_error=rotation,
        translation_error=translation,
        outcome=outcome,
        repeatability=repeatability,
        matching_score=fresh.floats(PAIRS),
        spread=fresh.floats(PAIRS),
    )


def calibration(fresh: Fresh) -> CalibrationResult:
    ece, mce, brier = fresh.floats(3)
    frequency = fresh.floats(5)
    frequency[2] = np.nan
    return CalibrationResult(
        ece=float(ece),
        mce=float(mce),
        brier=float(brier),
        edges=np.linspace(0, 1, 6),
        count=fresh.counts(5),
        mean_score=fresh.floats(5),
        frequency=frequency,
    )


def points_needed(seed: int, failures: int) -> np.ndarray:
    n_k = np.stack([np.random.default_rng(seed + k).permutation(N_MAX)[: PAIRS * REPEATS] + 1.0 for k in KS], -1)
    n_k = n_k.reshape(PAIRS, REPEATS, len(KS))
    n_k[2, :failures] = np.inf  # of one pair, in some repeats or in all
    return n_k


def method(fresh: Fresh, key: str, name: str, table: PairTable, turn: int, probabilities: bool) -> MethodResult:
    """n_k of each k are different numbers in [1, N_MAX]; a few are failures. Judged ones are others."""
    n_k, n_k_judged = points_needed(10 * turn, 1 + 3 * turn), points_needed(10 * turn + 100, 2 + turn)
    rotation_error = fresh.floats(PAIRS, REPEATS, len(KS), scale=3)
    translation_error = fresh.floats(PAIRS, REPEATS, len(KS), scale=2)
    for errors in (rotation_error, translation_error):
        errors[np.isnan(table.rotation)] = np.nan
        errors[~np.isfinite(n_k)] = np.inf
    return MethodResult(
        key=key,
        name=name,
        protocol={
            "detector": name,
            "k": K,
            "n": N,
            "ks": list(KS),
            "budgets": list(BUDGETS),
            "translation_limit": METRES,
            "rotation_limit": DEGREES,
            "search": "exact",
            "own": turn,
        },
        pairs=table,
        ks=KS,
        n_max=N_MAX,
        n_k=n_k,
        n_k_judged=n_k_judged,
        unknown=fresh.floats(PAIRS),
        rotation_error=rotation_error,
        translation_error=translation_error,
        points0=fresh.counts(PAIRS),
        points1=fresh.counts(PAIRS),
        budgets={n: at_budget(fresh, n, table, turn + n // 20) for n in BUDGETS},
        calibration={n: calibration(fresh) for n in CALIBRATED} if probabilities else {},
        milliseconds=dict(zip(STAGES, fresh.floats(len(STAGES), scale=50).tolist(), strict=True)),
        defects=dict(zip(DEFECTS, fresh.counts(len(DEFECTS)).tolist(), strict=True)),
    )


def golden() -> PairSetResult:
    """Two methods, the first with probabilities, on six pairs; nobody knows the pose of the last pair."""
    fresh = Fresh()
    rotation, translation = fresh.floats(PAIRS, scale=30), fresh.floats(PAIRS, scale=3)
    rotation[-1] = translation[-1] = np.nan
    apart = np.full(PAIRS, 3.0), np.array([8, 16, np.nan, 40, 32, 24.5])
    table = PairTable(
        tuple(f"drive:{i}-{i + 3}" for i in range(PAIRS)), fresh.floats(PAIRS), *apart, rotation, translation
    )
    methods = (
        method(fresh, "alpha", "Alpha + RootSIFT", table, 0, probabilities=True),
        method(fresh, "beta", "Beta", table, 1, probabilities=False),
    )
    protocol = {
        "pairs": PAIRS,
        "overlap": 0.25,
        "seed": 3,
        "verification": [{"inliers": "stereo_p3p", "threshold": 2.5}],
        "sequences": ["drive"],
    }
    return PairSetResult("kitti", "KITTI", protocol, methods, {"gone": "no weights"})


def all_numbers(result: PairSetResult) -> list[float]:
    """Every measured number that is known and finite, but for n_k and outcomes, which count the same things."""
    arrays = [
        result.detectors[0].pairs.overlap,
        result.detectors[0].pairs.rotation,
        result.detectors[0].pairs.translation,
    ]
    for m in result.detectors:
        arrays += [m.rotation_error, m.translation_error, m.points0, m.points1, m.unknown]
        arrays += [np.array([*m.milliseconds.values(), *m.defects.values()])]
        for at in m.budgets.values():
            arrays += [at.matches, at.inliers, at.rotation_error, at.translation_error]
            arrays += [at.repeatability, at.matching_score, at.spread]
        for c in m.calibration.values():
            arrays += [np.array([c.ece, c.mce, c.brier]), c.count, c.mean_score, c.frequency]
    values = np.concatenate([np.asarray(array, float).ravel() for array in arrays])
    return values[np.isfinite(values)].tolist()


def _turned(items: list, by: int) -> list:
    return items[by % len(items) :] + items[: by % len(items)]

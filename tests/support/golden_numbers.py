"""The numbers of the golden results, by the slow and obvious way."""

import math
import statistics

from golden_results import CALIBRATED, DEGREES, KS, METRES, N_MAX, REPEATS, STAGES, K, N

from sips_lit.evaluate.result import PoseOutcome


def column(array, repeat=None):
    """The numbers of all pairs, and of all repeats or of one, in a list."""
    return [float(x) for x in (array if repeat is None else array[:, repeat]).ravel()]


def curve(needed, n):
    return sum(x <= n for x in needed) / len(needed)


def area(needed):
    return sum(curve(needed, n) for n in range(N_MAX)) / N_MAX


def first_with(needed, share):
    return next((n for n in range(N_MAX + 1) if curve(needed, n) >= share), math.inf)


def pose_area(errors, limit):
    """Of a step curve from 0 to the limit: a pair counts from its error on."""
    known = [x for x in errors if not math.isnan(x)]
    return sum(max(0.0, limit - x) for x in known) / limit / len(known)


def mean(values):
    return statistics.fmean(x for x in values if not math.isnan(x))


def numbers(method):
    """Every number of the row of a method, by the key of its column."""
    needed, at = method.n_k[:, :, KS.index(K)], method.budgets[N]
    judged = method.n_k_judged[:, :, KS.index(K)]
    known = [kind for kind in at.outcome.ravel() if kind != PoseOutcome.UNKNOWN]
    row = {
        "n_at_80": first_with(column(needed), 0.8),
        "median_n": first_with(column(needed), 0.5),
        "mean_n": mean(x for x in column(needed) if x < math.inf),
        "auc": area(column(needed)),
        "failures": column(needed).count(math.inf) / REPEATS,
        "n_at_80_judged": first_with(column(judged), 0.8),
        "auc_judged": area(column(judged)),
        "unknown": mean(column(method.unknown)),
        "pose_auc_0.5m": pose_area(column(at.translation_error), METRES),
        "pose_auc_2deg": pose_area(column(at.rotation_error), DEGREES),
        "no_pose": sum(kind != PoseOutcome.FOUND for kind in known) / REPEATS,
        "repeatability": mean(column(at.repeatability)),
        "matching_score": mean(column(at.matching_score)),
        "spread": mean(column(at.spread)),
    }
    for n in CALIBRATED:
        row[f"ece_{n}"] = method.calibration[n].ece if method.calibration else math.nan
    row["points"] = mean([*column(method.points0), *column(method.points1)])
    return row | {f"{stage}_ms": method.milliseconds[stage] for stage in STAGES}


def deviations(method):
    """Standard deviations over the repeats, by the key of the column."""
    needed, at = method.n_k[:, :, KS.index(K)], method.budgets[N]
    judged = method.n_k_judged[:, :, KS.index(K)]
    return {
        "auc": statistics.stdev(area(column(needed, r)) for r in range(REPEATS)),
        "auc_judged": statistics.stdev(area(column(judged, r)) for r in range(REPEATS)),
        "pose_auc_0.5m": statistics.stdev(pose_area(column(at.translation_error, r), METRES) for r in range(REPEATS)),
        "pose_auc_2deg": statistics.stdev(pose_area(column(at.rotation_error, r), DEGREES) for r in range(REPEATS)),
    }


def middle(array, pair):
    """Of the repeats of a pair: a measured one, the better of two."""
    values = [float(x) for x in array[pair]]
    return math.nan if any(math.isnan(x) for x in values) else statistics.median_low(values)

"""The benchmark: many detectors on the same pairs, everything that is measured of each."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.sanitise import Defects
from sips_lit.errors import BadInputError
from sips_lit.evaluate.evaluation import versions
from sips_lit.evaluate.feature_cache import FeatureCache, ImageFeatures
from sips_lit.evaluate.features import has_scores
from sips_lit.evaluate.measure import Measures, PairMeasurement
from sips_lit.evaluate.method import Method
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.evaluate.result import NO_SCORES, AtBudget, MethodResult
from sips_lit.evaluate.verified_pair import measure_pair, with_memory
from sips_lit.metrics.calibration import Calibration, CalibrationResult


def run_methods(
    methods: Sequence[Method],
    pairs: PairSet,
    measures: Measures,
    cache_folder: Path,
    workers: int = 2,
    title: str = "",
    on_skip: Callable[[str, str], None] = lambda key, reason: None,
) -> list[MethodResult]:
    """Measures each method on all pairs, by ``workers`` threads.

    A method that fails on an image is told to ``on_skip`` with the reason, and left out. Raises BadInputError for
    frames that can't be read, and for pairs that their check can't judge.
    """
    for frame in tqdm(pairs.frames(), desc=f"{title}: images", unit="image", delay=2, leave=False):
        pairs.key(frame)  # an unreadable frame is nobody's fault among the methods
    results = []
    for method in methods:
        n = points_to_extract(method, measures)
        label = f"{title}, {method.name}"
        try:
            features = extract_all(method, pairs, cache_folder, n, label)
        except BadInputError as error:
            on_skip(method.key, str(error))
            continue
        measured = measure_all(method, pairs, features, measures, workers, label)
        results.append(summarise(method, pairs, measures, features, measured, n))
    return results


def has_probabilities(method: Method) -> bool:
    """Whether the scores are probabilities of being an inlier."""
    return isinstance(method.detector, SipsDetector)


def kind_of_scores(method: Method) -> str:
    """In a word, for the protocol: probability, order, or none (see `NO_SCORES`)."""
    if has_probabilities(method):
        return "probability"
    return "order" if has_scores(method.detector) else NO_SCORES


def points_to_extract(method: Method, measures: Measures) -> int:
    """How many points an image: the best n of SIPs are the first n of more; others, as ORB, choose others among more."""
    return max(measures.n_max, *measures.calibration, 0) if has_probabilities(method) else measures.n_max


def extract_all(
    method: Method, pairs: PairSet, cache_folder: Path, n: int, title: str
) -> dict[tuple[int, int], ImageFeatures]:
    """At most ``n`` features of every frame of the pairs, from the cache where they are there."""
    cache = FeatureCache(cache_folder, method, n)
    frames = pairs.frames()
    return {
        frame: cache(pairs.key(frame), partial(pairs.sequences[frame[0]].frame, frame[1]))
        for frame in tqdm(frames, desc=title, unit="image", delay=2, leave=False)
    }


def measure_all(
    method: Method,
    pairs: PairSet,
    features: Mapping[tuple[int, int], ImageFeatures],
    measures: Measures,
    workers: int,
    title: str,
) -> list[PairMeasurement]:
    """Each pair measured, in order."""
    kinds = has_probabilities(method), has_scores(method.detector)
    # a frame and its points are in several pairs, and asked for their depth several times in each
    checks = {id(check): with_memory(check) for check in map(pairs.check, range(len(pairs)))}

    def one(at: int) -> PairMeasurement:
        pair = pairs.listed[at]
        features0, features1 = (features[pair.sequence, index].features for index in (pair.index0, pair.index1))
        check = checks[id(pairs.check(at))]
        return measure_pair(pairs.read(at, depth=True), features0, features1, check, measures, *kinds)

    pool = ThreadPoolExecutor(max(1, workers))
    try:
        bar = tqdm(pool.map(one, range(len(pairs))), desc=title, unit="pair", delay=2, leave=False, total=len(pairs))
        return list(bar)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def summarise(
    method: Method,
    pairs: PairSet,
    measures: Measures,
    features: Mapping[tuple[int, int], ImageFeatures],
    measured: Sequence[PairMeasurement],
    n: int,
) -> MethodResult:
    """What was measured of all pairs as one record."""
    points0 = [len(features[p.sequence, p.index0].features) for p in pairs.listed]
    points1 = [len(features[p.sequence, p.index1].features) for p in pairs.listed]
    defects = sum((entry.defects for entry in features.values()), Defects())
    return MethodResult(
        key=method.key,
        name=method.name,
        protocol={
            "detector": method.detector.name,
            "descriptor": "own" if method.descriptor is None else method.descriptor.name,
            "scores": kind_of_scores(method),
            "extracted": n,
            **{key: list(value) if isinstance(value, tuple) else value for key, value in asdict(measures).items()},
            **pairs.protocol,
            "versions": versions(),
        },
        pairs=pairs.table(),
        ks=measures.ks,
        n_max=measures.n_max,
        n_k=np.stack([m.n_k for m in measured]),
        rotation_error=np.stack([m.rotation_error for m in measured]),
        translation_error=np.stack([m.translation_error for m in measured]),
        points0=np.minimum(points0, measures.n_max),
        points1=np.minimum(points1, measures.n_max),
        budgets={n: _at_budget(measured, n) for n in measures.budgets if all(n in m.budgets for m in measured)},
        calibration={n: _calibration(measured, n) for n in measures.calibration if n in measured[0].outcomes},
        milliseconds=_mean_times([e.milliseconds for e in features.values()], [m.milliseconds for m in measured]),
        defects=asdict(defects),
    )


def _at_budget(measured: Sequence[PairMeasurement], n: int) -> AtBudget:
    each = [m.budgets[n] for m in measured]
    return AtBudget(
        n=n,
        matches=np.array([b.matches for b in each], np.int64),
        inliers=np.stack([b.inliers for b in each]),
        rotation_error=np.stack([b.rotation_error for b in each]),
        translation_error=np.stack([b.translation_error for b in each]),
        outcome=np.stack([b.outcome for b in each]),
        repeatability=np.array([b.repeated.repeatability for b in each]),
        matching_score=np.array([b.repeated.matching_score for b in each]),
        spread=np.array([b.spread for b in each]),
    )


def _calibration(measured: Sequence[PairMeasurement], n: int) -> CalibrationResult:
    calibration = Calibration(20)
    for scores, inlier in (m.outcomes[n] for m in measured):
        calibration.update(torch.from_numpy(scores), torch.from_numpy(inlier))
    return calibration.result()


def _mean_times(*groups: Sequence[Any]) -> dict[str, float]:
    """Mean of each stage over all that have it."""
    times: dict[str, list[float]] = defaultdict(list)
    for group in groups:
        for stages in group:
            for stage, milliseconds in stages.items():
                times[stage].append(milliseconds)
    return {stage: math.fsum(values) / len(values) for stage, values in times.items()}

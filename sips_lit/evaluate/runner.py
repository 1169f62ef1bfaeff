"""The evaluation: methods on pair sets, everything that is measured of each; or one detector, in one call."""

from __future__ import annotations

import importlib.metadata
import math
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from sips_lit.detect.sanitise import Defects
from sips_lit.errors import BadInputError
from sips_lit.evaluate.features import FeatureCache, ImageFeatures, with_depth
from sips_lit.evaluate.measure import PairMeasurement, measure_pair
from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.method import Method, library_versions
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.evaluate.result import AtBudget, MethodResult, PairSetResult
from sips_lit.files import safe_name
from sips_lit.frames.source import Source, as_sources
from sips_lit.geometry.projection import frame_view
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.metrics.calibration import Calibration, CalibrationResult
from sips_lit.metrics.covariance import CovarianceCalibration, CovarianceReliability
from sips_lit.pairs.choice import choose_pairs
from sips_lit.progress import progress
from sips_lit.types import Descriptor, Detector, ImageSequence, InlierCheck

Frame = tuple[int, int]


def evaluate_detector(
    detector: Detector,
    data: Sequence[ImageSequence] | Sequence[Source],
    inliers: InlierCheck,
    descriptor: Descriptor | None = None,
    *,
    pairs: int = 100,
    overlap: float = 0.5,
    seed: int = 0,
    measures: Measures | None = None,
    index_folder: str | Path | None = None,
    workers: int = 2,
) -> MethodResult:
    """What ``sips-evaluate`` measures, of ``detector`` with ``descriptor`` (None: its own) on random pairs of ``data``.

    ``inliers`` verifies the matches; ``measures`` says what is measured; ``index_folder`` keeps the overlap of the frames
    for the next call. Raises BadInputError for what the detector, the descriptor or the check cannot do, and for data
    without pairs of this ``overlap``.
    """
    sources, measures = as_sources(data), measures or Measures(seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        listed = choose_pairs(sources, index_folder or folder, "random", pairs, overlap, seed=seed, workers=workers)
    chosen = {"kind": "random", "overlap": overlap, "seed": seed}
    pair_set = PairSet(sources, listed, inliers, chosen=chosen).verifiable()
    name = detector.name if descriptor is None else f"{detector.name} + {descriptor.name}"
    method = Method(safe_name(name).lower(), name, detector, descriptor, {})
    result = evaluate_pair_set([method], pair_set, measures, None, workers)
    if not result.detectors:
        raise BadInputError(result.skipped[method.key])
    return result.detectors[0]


def evaluate_pair_set(
    methods: Sequence[Method],
    pairs: PairSet,
    measures: Measures,
    cache_folder: Path | None = None,
    workers: int = 2,
    on_skip: Callable[[str, str], None] = lambda key, reason: None,
) -> PairSetResult:
    """Measures each method on all pairs, by ``workers`` threads; features are kept in ``cache_folder``, if there is one.

    A method that fails on an image is left out; ``on_skip`` gets its key and the reason. Raises BadInputError for frames
    that cannot be read, and for pairs that their check cannot verify.
    """
    for frame in progress(pairs.frames(), desc=f"{pairs.title}: images", unit="image"):
        pairs.key_of(frame)  # an unreadable frame is no fault of a method
    results, skipped = [], {}
    for method in methods:
        label = f"{pairs.title}, {method.name}"
        try:
            features = extract_all(method, pairs, cache_folder, measures.points(method.detector.scores), label)
        except BadInputError as error:
            skipped[method.key] = str(error)
            on_skip(method.key, str(error))
            continue
        features = measure_depths(pairs, features, workers, label)
        measured = measure_all(method, pairs, features, measures, workers, label)
        results.append(summarise(method, pairs, measures, features, measured))
    return PairSetResult(pairs.key, pairs.title, pairs.protocol, tuple(results), skipped)


def extract_all(
    method: Method, pairs: PairSet, cache_folder: Path | None, n: int, title: str
) -> dict[Frame, ImageFeatures]:
    """At most ``n`` features of every frame of the pairs, from the cache where they are there."""
    cache = FeatureCache(cache_folder, method, n)
    return {
        frame: cache(pairs.key_of(frame), partial(pairs.sequences[frame[0]].frame, frame[1]))
        for frame in progress(pairs.frames(), desc=title, unit="image")
    }


def measure_depths(
    pairs: PairSet, features: Mapping[Frame, ImageFeatures], workers: int, title: str
) -> dict[Frame, ImageFeatures]:
    """The features with the depth of their keypoints, once per frame, where the data tells depth."""

    def one(frame: Frame) -> ImageFeatures:
        sequence, index = frame
        stereo = pairs.checks[sequence].stereo or StereoMatcher()
        return with_depth(features[frame], frame_view(pairs.sequences[sequence], index), stereo)

    return dict(zip(features, side_by_side(one, list(features), workers, f"{title}: depth", "image"), strict=True))


def measure_all(
    method: Method,
    pairs: PairSet,
    features: Mapping[Frame, ImageFeatures],
    measures: Measures,
    workers: int,
    title: str,
) -> list[PairMeasurement]:
    """Each pair measured, in order."""

    def one(at: int) -> PairMeasurement:
        pair = pairs.listed[at]
        features0, features1 = (features[pair.sequence, index].features for index in (pair.index0, pair.index1))
        read = pairs.read(at, depth=True)
        detector = method.detector
        return measure_pair(read, features0, features1, pairs.check(at), measures, detector.scores, detector.best)

    return side_by_side(one, range(len(pairs)), workers, title, "pair")


def side_by_side(work: Callable[[Any], Any], items: Sequence[Any], workers: int, title: str, unit: str) -> list[Any]:
    """The work on each item, in order, by ``workers`` threads."""
    pool = ThreadPoolExecutor(max(1, workers))
    try:
        return list(progress(pool.map(work, items), desc=title, unit=unit, total=len(items)))
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def summarise(
    method: Method,
    pairs: PairSet,
    measures: Measures,
    features: Mapping[Frame, ImageFeatures],
    measured: Sequence[PairMeasurement],
) -> MethodResult:
    """What was measured of all pairs as one record."""
    points0 = [len(features[p.sequence, p.index0].features) for p in pairs.listed]
    points1 = [len(features[p.sequence, p.index1].features) for p in pairs.listed]
    names = ("n_k", "n_k_judged", "unknown", "rotation_error", "translation_error")
    stacked = {name: np.stack([getattr(m, name) for m in measured]) for name in names}
    return MethodResult(
        key=method.key,
        name=method.name,
        protocol={
            "detector": method.detector.name,
            "descriptor": method.descriptor_name,
            **({} if method.checkpoint is None else {"checkpoint": method.checkpoint}),
            "scores": method.detector.scores,
            "extracted": measures.points(method.detector.scores),
            **measures.protocol,
            "search": search_used(measures, pairs),
            **pairs.protocol,
            "versions": versions(),
        },
        pairs=pairs.table(),
        ks=measures.every_k,
        n_max=measures.n_max,
        **stacked,
        points0=np.minimum(points0, measures.n_max),
        points1=np.minimum(points1, measures.n_max),
        budgets={n: _at_budget(measured, n) for n in measures.every_n if all(n in m.budgets for m in measured)},
        calibration={n: _calibration(measured, n) for n in measures.calibration if n in measured[0].outcomes},
        milliseconds=_mean_times([*(f.milliseconds for f in features.values()), *(m.milliseconds for m in measured)]),
        defects=asdict(sum((entry.defects for entry in features.values()), Defects())),
        covariance={n: _covariance(measured, n) for n in measures.every_n if any(n in m.residuals for m in measured)},
    )


def search_used(measures: Measures, pairs: PairSet) -> str:
    """What ``search`` comes to with the checks of these pairs: exact, binary, or both."""
    if measures.search != "auto":
        return measures.search
    checks = [pairs.check(at) for at in range(len(pairs))]
    return " and ".join(sorted({"exact" if check.independent else "binary" for check in checks}))


def versions() -> dict[str, str]:
    """Versions of what the numbers depend on."""
    return {
        "sips_lit": importlib.metadata.version("sips_lit"),
        "poselib": importlib.metadata.version("poselib"),
        **library_versions(),
    }


def _at_budget(measured: Sequence[PairMeasurement], n: int) -> AtBudget:
    each = [m.budgets[n] for m in measured]
    names = [f.name for f in fields(AtBudget) if f.name != "n"]
    return AtBudget(n, **{name: np.stack([getattr(at, name) for at in each]) for name in names})


def _calibration(measured: Sequence[PairMeasurement], n: int) -> CalibrationResult:
    calibration = Calibration(20)
    for scores, inlier in (m.outcomes[n] for m in measured):
        calibration.update(torch.from_numpy(scores), torch.from_numpy(inlier))
    return calibration.result()


def _covariance(measured: Sequence[PairMeasurement], n: int) -> CovarianceReliability:
    calibration = CovarianceCalibration(20)
    for residual, claimed in (m.residuals[n] for m in measured if n in m.residuals):
        calibration.update(residual, claimed)
    return calibration.result()


def _mean_times(each: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Mean of each stage over all that have it."""
    times: dict[str, list[float]] = defaultdict(list)
    for stages in each:
        for stage, milliseconds in stages.items():
            times[stage].append(milliseconds)
    return {stage: math.fsum(values) / len(values) for stage, values in times.items()}

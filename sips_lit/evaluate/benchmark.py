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
from numpy.typing import NDArray
from tqdm import tqdm

from sips_lit.baselines.checked import Defects
from sips_lit.detect.detector import SipsDetector
from sips_lit.errors import BadInputError
from sips_lit.evaluate.benchmark_result import AtBudget, DetectorResult, PairTable
from sips_lit.evaluate.contender import Contender
from sips_lit.evaluate.evaluation import versions
from sips_lit.evaluate.feature_cache import FeatureCache, ImageFeatures, image_key
from sips_lit.evaluate.frame_memory import FrameMemory, RememberedSequence
from sips_lit.evaluate.judged_pair import measure_pair
from sips_lit.evaluate.measure import Measures, PairMeasurement
from sips_lit.evaluate.pair_file import ListedPair
from sips_lit.frames.source import Source
from sips_lit.metrics.calibration import Calibration, CalibrationResult
from sips_lit.tracking.pairs import read_pair
from sips_lit.types import FramePair, ImageSequence, InlierCheck


class BenchmarkPairs:
    """The pairs of a pair set with the check of each; what is read stays in ``memory`` (of its own, if None is given).

    Raises BadInputError where there are no pairs.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        listed: Sequence[ListedPair],
        default: InlierCheck,
        memory: FrameMemory | None = None,
    ) -> None:
        memory = FrameMemory()
        if not listed:
            raise BadInputError("the pair set has no pairs: check its data and its kind of pairs")
        self.listed = list(listed)
        self.sequences = [RememberedSequence(s, memory) for source in sources for s in source.sequences]
        self._checks = [source.inliers or default for source in sources for _ in source.sequences]
        self._keys: dict[tuple[int, int], str] = {}

    def __len__(self) -> int:
        return len(self.listed)

    def check(self, at: int) -> InlierCheck:
        """What says which matches of pair ``at`` are inliers."""
        return self._checks[self.listed[at].sequence]

    def read(self, at: int, depth: bool) -> FramePair:
        """Pair ``at``; with depth maps or stereo partners only if ``depth``, or if its check needs them."""
        pair, check = self.listed[at], self.check(at)
        sequence = self.sequences[pair.sequence]
        return read_pair(sequence, pair.index0, pair.index1, check.uses_frames, depth or check.uses_depth)

    def frames(self) -> list[tuple[int, int]]:
        """Each different frame: the position of its sequence, and its index."""
        ends = [(p.sequence, index) for p in self.listed for index in (p.index0, p.index1)]
        return sorted(set(ends))

    def key(self, frame: tuple[int, int]) -> str:
        """A hash of the content of a frame."""
        if frame not in self._keys:
            self._keys[frame] = image_key(self.sequences[frame[0]].frame(frame[1]))
        return self._keys[frame]

    def table(self) -> PairTable:
        """Names, overlaps and true motions of all pairs."""
        names, motions = [], []
        for pair in self.listed:
            sequence = self.sequences[pair.sequence]
            names.append(f"{sequence.name}:{pair.index0}-{pair.index1}")
            motions.append(_motion(sequence, pair.index0, pair.index1))
        rotation, translation = np.array(motions, np.float64).reshape(-1, 2).T
        return PairTable(tuple(names), np.array([p.overlap for p in self.listed], np.float64), rotation, translation)

    @property
    def protocol(self) -> dict[str, Any]:
        """Which data, and how it is judged."""
        used = sorted({pair.sequence for pair in self.listed})
        checks = {id(self._checks[at]): dict(self._checks[at].protocol) for at in used}
        sizes = sorted({"{1}x{0}".format(*self.sequences[at].frame(0).shape) for at in used})
        return {
            "sequences": [self.sequences[at].name for at in used],
            "image_size": sizes,
            "pairs": len(self.listed),
            "verification": list(checks.values()),
        }


def run_contenders(
    contenders: Sequence[Contender],
    pairs: BenchmarkPairs,
    measures: Measures,
    cache_folder: Path,
    workers: int = 2,
    title: str = "",
    on_skip: Callable[[str, str], None] = lambda key, reason: None,
) -> list[DetectorResult]:
    """Measures each contender on all pairs, by ``workers`` threads.

    A contender that fails on an image is told to ``on_skip`` with the reason, and left out. Raises BadInputError for
    frames that can't be read, and for pairs that their check can't judge.
    """
    for frame in tqdm(pairs.frames(), desc=f"{title}: images", unit="image", delay=2, leave=False):
        pairs.key(frame)  # an unreadable frame is nobody's fault among the contenders
    results = []
    for contender in contenders:
        n = points_to_extract(contender, measures)
        label = f"{title}, {contender.name}"
        try:
            features = extract_all(contender, pairs, cache_folder, n, label)
        except BadInputError as error:
            on_skip(contender.key, str(error))
            continue
        measured = measure_all(pairs, features, measures, has_probabilities(contender), workers, label)
        results.append(summarise(contender, pairs, measures, features, measured, n))
    return results


def has_probabilities(contender: Contender) -> bool:
    """Whether the scores are probabilities of being an inlier."""
    return isinstance(contender.detector, SipsDetector)


def points_to_extract(contender: Contender, measures: Measures) -> int:
    """How many points an image: the best n of SIPs are the first n of more; others, as ORB, choose others among more."""
    return max(measures.n_max, *measures.calibration, 0) if has_probabilities(contender) else measures.n_max


def extract_all(
    contender: Contender, pairs: BenchmarkPairs, cache_folder: Path, n: int, title: str
) -> dict[tuple[int, int], ImageFeatures]:
    """At most ``n`` features of every frame of the pairs, from the cache where they are there."""
    cache = FeatureCache(cache_folder, contender, n)
    frames = pairs.frames()
    return {
        frame: cache(pairs.key(frame), partial(pairs.sequences[frame[0]].frame, frame[1]))
        for frame in tqdm(frames, desc=title, unit="image", delay=2, leave=False)
    }


def measure_all(
    pairs: BenchmarkPairs,
    features: Mapping[tuple[int, int], ImageFeatures],
    measures: Measures,
    probabilities: bool,
    workers: int,
    title: str,
) -> list[PairMeasurement]:
    """Each pair measured, in order."""

    def one(at: int) -> PairMeasurement:
        pair = pairs.listed[at]
        features0, features1 = (features[pair.sequence, index].features for index in (pair.index0, pair.index1))
        return measure_pair(pairs.read(at, depth=True), features0, features1, pairs.check(at), measures, probabilities)

    pool = ThreadPoolExecutor(max(1, workers))
    try:
        bar = tqdm(pool.map(one, range(len(pairs))), desc=title, unit="pair", delay=2, leave=False, total=len(pairs))
        return list(bar)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def summarise(
    contender: Contender,
    pairs: BenchmarkPairs,
    measures: Measures,
    features: Mapping[tuple[int, int], ImageFeatures],
    measured: Sequence[PairMeasurement],
    n: int,
) -> DetectorResult:
    """What was measured of all pairs as one record."""
    points0 = [len(features[p.sequence, p.index0].features) for p in pairs.listed]
    points1 = [len(features[p.sequence, p.index1].features) for p in pairs.listed]
    defects = sum((entry.defects for entry in features.values()), Defects())
    return DetectorResult(
        key=contender.key,
        name=contender.name,
        protocol={
            "detector": contender.detector.name,
            "descriptor": "own" if contender.descriptor is None else contender.descriptor.name,
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
        budgets={n: _at_budget(measured, n) for n in measures.budgets},
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


def _motion(sequence: ImageSequence, index0: int, index1: int) -> tuple[float, float]:
    """Rotation (degrees) and distance (metres) between two frames; NaN where poses are not known."""
    pose0, pose1 = sequence.pose(index0), sequence.pose(index1)
    if pose0 is None or pose1 is None:
        return math.nan, math.nan
    T: NDArray[np.float64] = np.linalg.inv(pose1) @ pose0
    cosine = float(np.clip((np.trace(T[:3, :3]) - 1) / 2, -1, 1))
    return math.degrees(math.acos(cosine)), float(np.linalg.norm(T[:3, 3]))

"""From a pair and the features of a detector to its measurement: matching, depth, verification, each timed."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from sips_lit.errors import BadInputError
from sips_lit.evaluate.measure import Measures, PairMeasurement, measure
from sips_lit.evaluate.pair_pose import for_repeat, pair_pose
from sips_lit.geometry.remembered_stereo import remembering
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.inliers.stereo_p3p import StereoP3PInliers
from sips_lit.inliers.verifier import ExactVerifier, SearchVerifier, Verifier
from sips_lit.match.mutual_nearest import MutualLifetimes, distances, mutual_nearest_lifetimes
from sips_lit.types import Features, FramePair, InlierCheck


def measure_pair(
    pair: FramePair,
    features0: Features,
    features1: Features,
    check: InlierCheck,
    m: Measures,
    probabilities: bool = False,
    scored: bool = True,
) -> PairMeasurement:
    """Matches, verifies and measures a pair. ``probabilities`` and ``scored``: as in `measure`.

    Raises BadInputError for a pair that the check can't judge.
    """
    milliseconds: dict[str, float] = {}
    with _timed(milliseconds, "match"):
        lifetimes = mutual_nearest_lifetimes(distances(features0, features1))
    with _timed(milliseconds, "verify"):
        judge = make_judge(pair, features0, features1, check, lifetimes, m)
    pose = None
    if m.pose:
        with _timed(milliseconds, "depth"):
            estimator = StereoP3PInliers(m.pose_threshold, m.iterations, m.seed, stereo_of(check))
            pose = pair_pose(pair, features0.keypoints, features1.keypoints, estimator)
    measured = measure(pair, features0, features1, judge, pose, m, stereo_of(check), probabilities, scored)
    for stage, elapsed in measured.milliseconds.items():
        milliseconds[stage] = milliseconds.get(stage, 0) + elapsed
    return replace(measured, milliseconds=milliseconds)


def stereo_of(check: InlierCheck) -> StereoMatcher:
    """The check's way to find depth by stereo, or the usual one if it has none."""
    return check.stereo if isinstance(check, StereoP3PInliers | PoseDepthInliers) else StereoMatcher()


def with_memory(check: InlierCheck) -> InlierCheck:
    """The same check, but that finds the depth of the same points by stereo only once."""
    if isinstance(check, StereoP3PInliers | PoseDepthInliers):
        return replace(check, stereo=remembering(check.stereo))
    return check


def make_judge(
    pair: FramePair,
    features0: Features,
    features1: Features,
    check: InlierCheck,
    lifetimes: MutualLifetimes,
    m: Measures,
) -> Verifier:
    """The exact judge for a check that is independent, else one that asks it for every budget of a search."""
    keypoints = features0.keypoints, features1.keypoints
    if check.independent:
        return ExactVerifier(lifetimes, check(pair, *keypoints, lifetimes.matches), m.n_max)
    if not isinstance(check, StereoP3PInliers):
        raise BadInputError(
            f"inliers={check.protocol['inliers']} judges all matches together and can't be repeated with other samples: "
            "choose stereo_p3p, or a check that judges each match by itself"
        )
    prepared = check.prepare(pair, *keypoints)
    return SearchVerifier(
        lifetimes, lambda matches, repeat: for_repeat(prepared, repeat)(matches), m.repeats, check.seed
    )


@contextmanager
def _timed(milliseconds: dict[str, float], stage: str) -> Iterator[None]:
    begin = time.perf_counter()
    yield
    milliseconds[stage] = 1e3 * (time.perf_counter() - begin)

"""Odometry of many methods with many numbers of points on the same frames, each read once."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.detect.sanitise import Defects
from sips_lit.errors import BadInputError
from sips_lit.evaluate.features import FeatureCache, ImageFeatures, image_key, with_depth
from sips_lit.evaluate.method import Method
from sips_lit.evaluate.runner import versions
from sips_lit.geometry.projection import View, frame_view
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.odometry.odometer import FramePoints, Located, Odometer, OdometrySettings
from sips_lit.odometry.result import OdometryResult, SequenceResult, make_run, message_bytes
from sips_lit.progress import progress
from sips_lit.types import Camera, ImageSequence


@dataclass(frozen=True, slots=True)
class Plan:
    """What is run on each sequence.

    ``ns`` points a frame, ``repeats`` seeds from ``seed`` on, every ``stride``-th frame, at most ``max_frames`` of them;
    drift over segments of ``segment`` metres. Raises BadInputError for what can't be run.
    """

    ns: tuple[int, ...] = (50,)
    settings: OdometrySettings = field(default_factory=OdometrySettings)
    repeats: int = 3
    seed: int = 0
    stride: int = 1
    max_frames: int | None = None
    segment: float = 100.0

    def __post_init__(self) -> None:
        if not self.ns or len(set(self.ns)) < len(self.ns):
            raise BadInputError(f"n is {list(self.ns)}: give different numbers of points a frame")
        least = self.settings.min_inliers
        if min(self.ns) < least:
            raise BadInputError(
                f"n is {min(self.ns)}, but a pose needs min_inliers = {least}: give as many points or more"
            )
        for name in ("repeats", "stride"):
            if getattr(self, name) < 1:
                raise BadInputError(f"{name} is {getattr(self, name)}: give at least 1")
        if self.max_frames is not None and self.max_frames < 2:
            raise BadInputError(f"max_frames is {self.max_frames}: a motion has at least 2 frames")
        if self.seed < 0:
            raise BadInputError(f"seed is {self.seed}: give 0 or more")
        if not self.segment > 0:
            raise BadInputError(f"segment is {self.segment}: give metres above 0")

    def frames(self, sequence: ImageSequence) -> list[int]:
        """Which frames are used."""
        return list(range(0, len(sequence), self.stride))[: self.max_frames]


@dataclass(slots=True)
class _Track:
    """A method with n points a frame, on its way, once for each seed."""

    method: Method
    n: int
    odometers: list[Odometer]
    located: list[list[Located]]
    sizes: list[tuple[int, int]] = field(default_factory=list)
    times: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    def step(self, found: ImageFeatures, camera: Camera) -> None:
        features = found.features.best(self.n)
        self.sizes.append((len(features), message_bytes(features)))
        frame = FramePoints.of(features, camera)
        begin = time.perf_counter()
        for odometer, located in zip(self.odometers, self.located, strict=True):
            located.append(odometer(frame))
        pose = 1e3 * (time.perf_counter() - begin) / len(self.odometers)
        for stage, milliseconds in (found.milliseconds | {"pose": pose}).items():
            self.times[stage].append(milliseconds)

    def result(self, truth: NDArray[np.float64], segment: float) -> OdometryResult:
        points, size = np.mean(self.sizes, axis=0).tolist()
        runs = tuple(make_run(located, truth, segment) for located in self.located)
        times = {stage: float(np.mean(values)) for stage, values in self.times.items()}
        return OdometryResult(self.method.key, self.method.name, self.n, runs, points, size, times)


@dataclass(slots=True)
class _Extraction:
    """The features of a method in each frame, for the tracks that use them."""

    method: Method
    cache: FeatureCache
    tracks: list[_Track]
    defects: Defects = field(default_factory=Defects)

    def step(self, view: View, key: str, stereo: StereoMatcher) -> None:
        found = with_depth(self.cache(key, lambda: view.image), view, stereo)
        self.defects += found.defects
        for track in self.tracks:
            track.step(found, view.camera)


def run_sequence(
    sequence: ImageSequence,
    methods: Sequence[Method],
    plan: Plan,
    cache_folder: Path | None = None,
    on_skip: Callable[[str, str], None] = lambda key, reason: None,
    on_defects: Callable[[str, Defects], None] = lambda name, defects: None,
) -> SequenceResult:
    """Every method with every number of points on the same frames of a sequence; features are kept in ``cache_folder``.

    A method that fails on an image is left out; ``on_skip`` gets its key and the reason. Raises BadInputError for a sequence
    without depth or cameras, of one frame, with poses that are not finite, or with frames that can't be read.
    """
    frames = plan.frames(sequence)
    check_sequence(sequence, frames)
    truth, stereo = true_poses(sequence, frames), StereoMatcher()
    start = truth[0] if np.isfinite(truth[0]).all() else None
    extractions = [one for method in methods for one in _extractions(method, plan, cache_folder, start)]
    skipped: dict[str, str] = {}
    for index in progress(frames, desc=sequence.name, unit="frame"):
        view = frame_view(sequence, index)
        if view is None:
            raise BadInputError(f"frame {index} of {sequence.name} has no camera, which odometry needs: leave it out")
        key = image_key(view.image)
        for one in extractions:
            if one.method.key in skipped:
                continue
            try:
                one.step(view, key, stereo)
            except BadInputError as error:
                skipped[one.method.key] = str(error)
                on_skip(one.method.key, str(error))
    left = [one for one in extractions if one.method.key not in skipped]
    for one in left:
        on_defects(f"{one.method.name}, {one.cache.n} points", one.defects)
    times = [sequence.time(index) for index in frames]
    known = [float(i) if t is None else t for i, t in zip(frames, times, strict=True)]
    protocol = _protocol(sequence, plan, frames, None not in times, stereo)
    results = tuple(track.result(truth, plan.segment) for one in left for track in one.tracks)
    return SequenceResult(sequence.name, protocol, np.array(known), truth, results, skipped)


def check_sequence(sequence: ImageSequence, frames: Sequence[int]) -> None:
    """Raises BadInputError for a sequence in which no camera can be followed."""
    what = f"{sequence.name}, which odometry needs: use stereo, RGB-D or posed depth (kitti, euroc, rgbd, posed_depth, ...)"
    if not sequence.temporal:
        raise BadInputError(
            f"the images of {sequence.name} are in no order in time: odometry needs frames of one camera"
        )
    if len(frames) < 2:
        raise BadInputError(f"{sequence.name} has one frame with this stride, a motion has two: give more frames")
    if sequence.camera(frames[0]) is None:
        raise BadInputError(f"there is no camera calibration of {what}")
    if not any(_tells_depth(sequence, index) for index in frames):
        raise BadInputError(f"there are no depth maps and no right images with a baseline of {what}")


def true_poses(sequence: ImageSequence, frames: Sequence[int]) -> NDArray[np.float64]:
    """``T_world_camera`` (N, 4, 4) of the frames, NaN where none is known. Raises BadInputError for one not finite."""
    poses = np.full((len(frames), 4, 4), np.nan)
    for row, index in enumerate(frames):
        pose = sequence.pose(index)
        if pose is None:
            continue
        if not np.isfinite(pose).all():
            raise BadInputError(f"the pose of frame {index} of {sequence.name} is not finite: mend its file of poses")
        poses[row] = pose
    return poses


def _extractions(
    method: Method, plan: Plan, cache_folder: Path | None, start: NDArray[np.float64] | None
) -> list[_Extraction]:
    """One for all numbers of points where the best n are the first n of more (probabilities), else one for each."""

    def track(n: int) -> _Track:
        odometers = [Odometer(plan.settings, plan.seed + repeat, start) for repeat in range(plan.repeats)]
        return _Track(method, n, odometers, [[] for _ in odometers])

    groups = [plan.ns] if method.detector.scores == "probability" else [(n,) for n in plan.ns]
    return [_Extraction(method, FeatureCache(cache_folder, method, max(ns)), [track(n) for n in ns]) for ns in groups]


def _tells_depth(sequence: ImageSequence, index: int) -> bool:
    return sequence.depth(index) is not None or bool(sequence.baseline() and sequence.right(index) is not None)


def _protocol(
    sequence: ImageSequence, plan: Plan, frames: Sequence[int], timed: bool, stereo: StereoMatcher
) -> dict[str, Any]:
    """How the numbers came about."""
    mapped = sequence.depth(frames[0]) is not None
    return {
        "sequence": sequence.name,
        "frames": len(frames),
        "stride": plan.stride,
        "timestamps": "seconds" if timed else "frame numbers",
        "depth": {"source": "maps"} if mapped else {"source": "stereo", **stereo.parameters},
        **plan.settings.protocol,
        "seeds": [plan.seed + repeat for repeat in range(plan.repeats)],
        "segment": plan.segment,
        "versions": versions(),
    }

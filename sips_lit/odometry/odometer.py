"""Visual odometry, frame to keyframe: points of the keyframe in space, P3P in LO-RANSAC, the pose refined on its inliers.

Nothing else: no map, no bundle adjustment, no loops. So the drift tells what the points are worth (our choice).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.geometry.pnp import ESTIMATOR, p3p_ransac
from sips_lit.geometry.projection import back_project
from sips_lit.geometry.weighted_pose import refine_pose
from sips_lit.matching.mutual_nearest import distances, mutual_nearest
from sips_lit.types import Camera, Features, FloatArray


@dataclass(frozen=True, slots=True)
class OdometrySettings:
    """How poses are found, and when a frame becomes the keyframe.

    ``threshold``: pixels of reprojection error of an inlier; ``iterations`` of RANSAC; ``min_inliers``: a pose with fewer is
    none (three determine it, the others confirm it). A frame becomes the keyframe when its inliers are fewer than
    ``keyframe_inliers`` times those of the first frame after the keyframe, or the median inlier has moved by more than
    ``keyframe_motion`` times the longer side of the image. Raises BadInputError for values that can't be.
    """

    threshold: float = 2.0
    iterations: int = 1000
    min_inliers: int = 6
    keyframe_inliers: float = 0.7
    keyframe_motion: float = 0.1

    def __post_init__(self) -> None:
        if not 0 < self.threshold < np.inf:
            raise BadInputError(f"threshold is {self.threshold}: give pixels above 0")
        if self.iterations < 1:
            raise BadInputError(f"iterations is {self.iterations}: give at least 1")
        if self.min_inliers < 4:
            raise BadInputError(f"min_inliers is {self.min_inliers}: three fit any pose, give at least 4")
        if not 0 <= self.keyframe_inliers <= 1:
            raise BadInputError(f"keyframe_inliers is {self.keyframe_inliers}: give a share from 0 to 1")
        if not self.keyframe_motion >= 0:
            raise BadInputError(f"keyframe_motion is {self.keyframe_motion}: give a share of the image's side from 0")

    @property
    def protocol(self) -> dict[str, Any]:
        """All of it, for results."""
        return {"estimator": f"{ESTIMATOR}, refined on inliers", **asdict(self)}


@dataclass(frozen=True, slots=True)
class FramePoints:
    """Features of a frame, where they are in space (N, 3), in the frame's ``camera``, metres; NaN where that is unknown."""

    features: Features
    points: NDArray[np.float64]
    camera: Camera

    @classmethod
    def of(cls, features: Features, camera: Camera) -> FramePoints:
        """From the depth that the keypoints bring, which may be none."""
        keypoints = features.keypoints
        depth = np.full(len(keypoints), np.nan) if keypoints.depth is None else keypoints.depth
        return cls(features, back_project(keypoints.xy, depth, camera), camera)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which points are known in space (N,)."""
        return np.asarray(np.isfinite(self.points).all(1), np.bool_)


class State(IntEnum):
    """How the pose of a frame came about."""

    FIRST = 0
    TRACKED = 1
    """By points of the keyframe, or of the frame before."""
    BRIDGED = 2
    """By the motion before: too few points agreed."""


@dataclass(frozen=True, slots=True)
class Located:
    """Where a frame was taken.

    ``pose``: ``T_world_camera`` (4, 4); ``inliers``: how many agreed with it; ``keyframe``: whether the frame became one.
    """

    pose: NDArray[np.float64]
    inliers: int
    state: State
    keyframe: bool


@dataclass(frozen=True, slots=True)
class _Reference:
    frame: FramePoints
    pose: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Found:
    pose: NDArray[np.float64]
    inliers: int
    motion: float


class Odometer:
    """Takes the frames of a sequence one by one, and says where each was taken.

    A frame is located by the keyframe's points, and if too few agree by those of the frame before. If these are too few as
    well, it moves as the last frame did (constant velocity), and is told as bridged; the keyframe stays. The samples of
    RANSAC depend on ``seed`` and the number of the frame only. ``start``: ``T_world_camera`` (4, 4) of the first frame.
    """

    def __init__(self, settings: OdometrySettings, seed: int = 0, start: FloatArray | None = None) -> None:
        self.settings, self.seed = settings, seed
        self._start = np.eye(4) if start is None else np.array(start, np.float64)
        self._motion: NDArray[np.float64] = np.eye(4)  # of the last frame, in the camera before
        self._count, self._first_inliers = 0, 0
        self._key: _Reference | None = None
        self._last: _Reference | None = None

    def __call__(self, frame: FramePoints) -> Located:
        """Where the next frame was taken."""
        index, self._count = self._count, self._count + 1
        if self._key is None or self._last is None:
            self._key = self._last = _Reference(frame, self._start)
            return Located(self._start, 0, State.FIRST, True)
        found, by_key = self._find(self._key, frame, index, 1), True
        if found is None and self._last is not self._key:
            found, by_key = self._find(self._last, frame, index, 2), False
        if found is None:
            located = Located(self._last.pose @ self._motion, 0, State.BRIDGED, False)
        else:
            located = Located(found.pose, found.inliers, State.TRACKED, self._becomes_key(found, by_key, frame))
        self._motion = np.asarray(np.linalg.solve(self._last.pose, located.pose), np.float64)
        self._last = _Reference(frame, located.pose)
        if located.keyframe:
            self._key, self._first_inliers = self._last, 0
        return located

    def _becomes_key(self, found: _Found, by_key: bool, frame: FramePoints) -> bool:
        s = self.settings
        if frame.known.sum() < s.min_inliers:
            return False
        if not by_key:
            return True
        self._first_inliers = self._first_inliers or found.inliers
        return found.inliers < s.keyframe_inliers * self._first_inliers or found.motion > s.keyframe_motion

    def _find(self, reference: _Reference, frame: FramePoints, index: int, attempt: int) -> _Found | None:
        """The pose of a frame by the points of a reference; None if too few agree."""
        s, there = self.settings, reference.frame
        matches = mutual_nearest(distances(there.features, frame.features))
        usable = there.known[matches.index0]
        i, j = matches.index0[usable], matches.index1[usable]
        if len(i) < s.min_inliers:
            return None
        points, pixels = there.points[i], np.asarray(frame.features.keypoints.xy[j], np.float64)
        generator = np.random.default_rng(
            [self.seed, index, attempt]
        )  # attempt is never 0: numpy ignores zeros at the end
        estimate = p3p_ransac(points, pixels, frame.camera, generator, s.iterations, s.threshold)
        if estimate.T_1_0 is None or estimate.inliers < s.min_inliers:
            return None
        inlier = estimate.inlier
        alike = np.broadcast_to(np.eye(2), (estimate.inliers, 2, 2))
        T = refine_pose(estimate.T_1_0, points[inlier], pixels[inlier], alike, frame.camera)
        moved = np.linalg.norm(pixels[inlier] - there.features.keypoints.xy[i[inlier]], axis=1)
        motion = float(np.median(moved)) / max(frame.camera.size)
        return _Found(reference.pose @ np.linalg.inv(T), estimate.inliers, motion)

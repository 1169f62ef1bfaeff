"""True poses made truer: the pose of a pair from tracks of corners and measured depth, whatever detectors are compared.

Poses of a data set come from other instruments (GPS, motion capture), depth from its own cameras, and small errors of both
add up: a truth that few tracks agree with says little about matches. Our choice; the paper verifies by poses that it
estimates from the matches themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from sips_lit.geometry.pnp import ESTIMATOR, p3p_ransac
from sips_lit.geometry.projection import back_project, posed_views, project
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.pairs.overlap import OverlapParameters, corners_to_track
from sips_lit.tracking.klt import KltTracker
from sips_lit.types import DisparityMatcher, FloatArray, FramePair

FEWEST_TRACKS: Final = 50  # that determine a pose, and that have to agree with it
AGREEMENT: Final = 1.5  # pixels between a track's end and where a pose puts it
ITERATIONS: Final = 1000  # of P3P in LO-RANSAC
PROTOCOL: Final = f"{ESTIMATOR}, {ITERATIONS} samples, on KLT tracks of corners that agree within {AGREEMENT} px"


@dataclass(frozen=True, slots=True)
class RefinedPose:
    """``T_1_0`` (4, 4) of a pair, and the shares of the ``tracks`` that agree with the ``given`` pose and with this one."""

    T_1_0: FloatArray
    tracks: int
    given: float
    refined: float

    @property
    def kept(self) -> bool:
        """Whether it is the pose as given: there are too few tracks, or no more of them agree with another."""
        return self.given == self.refined


def refine_pose(
    pair: FramePair, stereo: DisparityMatcher | None = None, tracker: KltTracker | None = None
) -> RefinedPose | None:
    """The pose that most tracks of corners through all ``frames`` of the pair agree with, given their depth in image 0.

    The given pose stays where fewer than `FEWEST_TRACKS` agree with another, or no more than with it. None where the pose,
    or the depth of image 0, is not known.
    """
    posed = posed_views(pair)
    if posed is None or not posed[0].tells_depth:
        return None
    view0, view1, given = posed
    image = pair.frames[0]
    corners = corners_to_track(image, np.zeros((0, 2), np.float32), OverlapParameters())
    ends, survived = (tracker or KltTracker()).track(pair.frames, corners)
    points = back_project(corners, view0.depth_at(corners, stereo or StereoMatcher()), view0.camera)
    usable = survived & np.isfinite(points).all(1)
    points, ends = points[usable], ends[usable]

    def agreeing(T: FloatArray) -> float:
        if not len(points):
            return 0.0
        with np.errstate(invalid="ignore"):
            errors = np.linalg.norm(project(points @ T[:3, :3].T + T[:3, 3], view1.camera) - ends, axis=1)
            return float(np.mean(errors <= AGREEMENT))

    found = p3p_ransac(points, ends, view1.camera, np.random.default_rng(0), ITERATIONS, AGREEMENT)
    before = agreeing(given)
    if found.T_1_0 is None or found.inliers < FEWEST_TRACKS or agreeing(found.T_1_0) <= before:
        return RefinedPose(given, len(points), before, before)
    return RefinedPose(found.T_1_0, len(points), before, agreeing(found.T_1_0))


def with_pose(pair: FramePair, refined: RefinedPose | None) -> FramePair:
    """The pair with the refined pose, if there is one."""
    if refined is None or pair.geometry is None:
        return pair
    return replace(pair, geometry=replace(pair.geometry, T_1_0=refined.T_1_0))


def summary(poses: Sequence[RefinedPose | None]) -> dict[str, Any]:
    """For protocols: how, for how many pairs, and the median shares of tracks that agree before and after."""
    known = [pose for pose in poses if pose is not None]
    changed = [pose for pose in known if not pose.kept]
    return {
        "method": PROTOCOL,
        "pairs": len(changed),
        "kept": len(poses) - len(changed),
        "agree_given": round(float(np.median([pose.given for pose in known])), 3) if known else None,
        "agree_refined": round(float(np.median([pose.refined for pose in known])), 3) if known else None,
    }

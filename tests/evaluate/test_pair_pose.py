import math
from dataclasses import replace

import numpy as np
import pytest
from textured_scenes import keypoints
from wall_scene import DISTANCE, FOCAL, Wall

from sips_lit.evaluate.measure import pair_pose
from sips_lit.evaluate.result import PoseOutcome
from sips_lit.inliers.stereo_p3p import StereoP3PInliers
from sips_lit.pairs.sampler import read_pair
from sips_lit.types import Matches

CHECK = StereoP3PInliers(iterations=200)
GRID = np.array([[x, y] for x in range(40, 140, 12) for y in range(30, 110, 13)], np.float32)


def scene(wall: Wall, error: float = 0.0):
    """Frames 0 and 2, 16 pixels apart: true correspondences, and how far the first points are off."""
    pair = read_pair(wall, 0, 2, between=False)
    return pair, keypoints(GRID), keypoints(GRID - (16 - error, 8))


def identity(count: int) -> Matches:
    return Matches(np.arange(count), np.arange(count))


@pytest.mark.parametrize("stereo", [False, True])
def test_true_correspondences_give_the_true_pose(stereo):
    pose = pair_pose(*scene(Wall(4, depth=not stereo, stereo=stereo)), CHECK)
    rotation, translation, outcome = pose.errors(identity(len(GRID)), 0)
    assert outcome == PoseOutcome.FOUND
    assert rotation < 0.05
    assert translation < 0.02
    assert pose.T_1_0[0, 3] == pytest.approx(-16 * DISTANCE / FOCAL)


def test_an_error_is_measured():
    """Points that are all 5 px off put the camera half a metre aside: a metre is ten pixels."""
    rotation, translation, _ = pair_pose(*scene(Wall(4), 5.0), CHECK).errors(identity(len(GRID)), 0)
    assert translation == pytest.approx(0.5, abs=0.05)
    assert rotation < 0.3


def test_failures_are_infinite():
    pose = pair_pose(*scene(Wall(4)), CHECK)
    assert pose.errors(identity(3), 0) == (math.inf, math.inf, PoseOutcome.FEW_MATCHES)
    assert pose.errors(identity(0), 0) == (math.inf, math.inf, PoseOutcome.FEW_MATCHES)
    assert pose.errors(identity(9), 0, least=10) == (math.inf, math.inf, PoseOutcome.FEW_INLIERS)
    assert pose.errors(identity(10), 0, least=10)[1] < 0.1


def test_points_without_depth_do_not_count():
    wall = Wall(4)
    depth = wall.depth(0)
    depth[:, 60:] = np.nan
    wall.depth = lambda index: depth
    pose = pair_pose(*scene(wall), CHECK)
    known = np.flatnonzero(GRID[:, 0] < 60)
    assert pose.errors(Matches(known, known), 0)[1] < 0.1
    unknown = np.flatnonzero(GRID[:, 0] > 60)
    assert pose.errors(Matches(unknown, unknown), 0) == (math.inf, math.inf, PoseOutcome.FEW_MATCHES)


def test_ransac_that_finds_nothing():
    """Four points of one line of sight each: no triple is a triangle."""
    pair, points, _ = scene(Wall(4))
    same = keypoints(np.repeat(GRID[:1], 4, 0))
    pose = pair_pose(pair, same, points, CHECK)
    assert pose.errors(identity(4), 0) == (math.inf, math.inf, PoseOutcome.NO_AGREEMENT)


def test_nobody_knows():
    for wall in (Wall(4, poses=False), Wall(4, depth=False), Wall(4, poses=False, stereo=True, depth=False)):
        assert pair_pose(*scene(wall), CHECK) is None


def test_repeats_have_samples_of_their_own():
    """Half of the points are wrong: few samples find poses that differ, always the same for a repeat."""
    pair, points0, points1 = scene(Wall(4))
    points1.xy[::2] += np.random.default_rng(0).uniform(5, 30, points1.xy[::2].shape).astype(np.float32)
    pose = pair_pose(pair, points0, points1, StereoP3PInliers(iterations=3))
    errors = [pose.errors(identity(len(GRID)), repeat)[1] for repeat in (0, 1, 2, 0)]
    assert len(set(errors[:3])) > 1
    assert errors[3] == errors[0]


def unsure(points, sigma):
    """Points that claim these standard deviations (N,) in all directions."""
    return replace(
        points, covariance=(np.asarray(sigma) ** 2)[:, None, None].astype(np.float32) * np.eye(2, dtype=np.float32)
    )


@pytest.mark.parametrize("stereo_in", [0, 1])
def test_sure_points_weigh_more_in_a_refined_pose(stereo_in):
    """Every third point is off by two pixels, and says that it may be; depth is known in one image or in the other."""
    wall = Wall(4)
    if stereo_in:
        depth, nothing = wall.depth, np.full_like(wall.depth(0), np.nan)
        wall.depth = lambda index: depth(index) if index else None
        assert nothing.shape
    pair, points0, points1 = scene(wall)
    off = np.arange(len(GRID)) % 3 == 0
    moved = points1.xy + np.where(off[:, None], [1.4, -1.4], [0, 0]).astype(np.float32)
    sigma = np.where(off, 2.0, 0.05)
    points0, points1 = unsure(points0, sigma), unsure(replace(points1, xy=moved), sigma)
    errors = {
        weights: pair_pose(pair, points0, points1, CHECK, weights).errors(identity(len(GRID)), 0)
        for weights in ("none", "equal", "covariance")
    }
    assert errors["covariance"].translation < 0.01
    assert errors["covariance"].rotation < 0.01
    assert errors["equal"].translation > 0.02


def test_points_without_covariances_weigh_the_same():
    pair, points0, points1 = scene(Wall(4), 0.7)
    equal, claimed = (
        pair_pose(pair, points0, points1, CHECK, weights).errors(identity(len(GRID)), 0)
        for weights in ("equal", "covariance")
    )
    assert equal == claimed

import copy
from dataclasses import replace

import cv2
import numpy as np
import pytest
from textured_scenes import texture
from wall_scene import Wall

from sips_lit.datasets.virtual_flight import flights_over
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.frames.source import Source
from sips_lit.geometry.pose import rotation_error, translation_error
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.pairs.choice import ListedPair
from sips_lit.pairs.pose_refinement import refine_pose, summary, with_pose
from sips_lit.pairs.sampler import read_pair
from sips_lit.types import Camera, FramePair, ImageSequence


@pytest.fixture(scope="module")
def flight() -> ImageSequence:
    """Planes at several depths, with exact poses."""
    stills = [(name, cv2.GaussianBlur(texture(500, 700, seed), (0, 0), 1.5)) for seed, name in enumerate("ab")]
    return flights_over(stills, (320, 240), 40, 1, 3, layers=2)[0]


def disturbed(pair: FramePair, degrees: float = 0.5, longer: float = 1.1) -> FramePair:
    off = pair.geometry.T_1_0.copy()
    off[:3, :3] = cv2.Rodrigues(np.radians([0, degrees, 0]))[0] @ off[:3, :3]
    off[:3, 3] *= longer
    return replace(pair, geometry=replace(pair.geometry, T_1_0=off))


def test_a_disturbed_pose_is_mended(flight: ImageSequence):
    pair = read_pair(flight, 3, 9)
    truth = pair.geometry.T_1_0
    off = disturbed(pair)
    refined = refine_pose(off)
    assert refined.tracks > 100
    assert not refined.kept
    assert refined.given < 0.5 < refined.refined
    assert rotation_error(refined.T_1_0, truth) < 0.25 * rotation_error(off.geometry.T_1_0, truth)
    assert translation_error(refined.T_1_0, truth) < 0.3 * translation_error(off.geometry.T_1_0, truth)
    mended = with_pose(off, refined)
    np.testing.assert_array_equal(mended.geometry.T_1_0, refined.T_1_0)
    assert mended.geometry.depth0 is off.geometry.depth0


def test_a_right_pose_stays_right(flight: ImageSequence):
    pair = read_pair(flight, 9, 3)
    refined = refine_pose(pair)
    assert refined.given > 0.8
    assert rotation_error(refined.T_1_0, pair.geometry.T_1_0) < 0.1


def test_cameras_may_differ(flight: ImageSequence):
    """The camera of image 1 has a focal length that is 1.15 times as long."""
    pair = read_pair(flight, 3, 9)
    width, height = pair.image1.shape[::-1]
    zoom = np.array([[1.15, 0, -0.075 * (width - 1)], [0, 1.15, -0.075 * (height - 1)], [0, 0, 1]])
    frames = (*pair.frames[:-1], cv2.warpPerspective(pair.frames[-1], zoom, (width, height), flags=cv2.INTER_CUBIC))
    camera1 = Camera(zoom @ pair.geometry.camera1.matrix, (width, height))
    zoomed = replace(pair, frames=frames, geometry=replace(pair.geometry, camera1=camera1, depth1=None))
    refined = refine_pose(disturbed(zoomed))
    assert not refined.kept
    assert refined.refined > 0.5
    assert rotation_error(refined.T_1_0, pair.geometry.T_1_0) < 0.2


def test_a_pose_that_few_tracks_agree_with_is_not_taken():
    """Frames of noise: the few tracks there are by chance agree with some pose, and with none in truth."""
    generator = np.random.default_rng(0)
    pair = read_pair(Wall(3), 0, 2)
    noise = tuple(generator.integers(0, 255, frame.shape, np.uint8) for frame in pair.frames)
    refined = refine_pose(replace(pair, frames=noise))
    assert refined.kept
    np.testing.assert_array_equal(refined.T_1_0, pair.geometry.T_1_0)


def test_stereo_partners_tell_depth_too():
    pair = read_pair(Wall(4, depth=False, stereo=True), 0, 2)
    refined = refine_pose(disturbed(pair, 1.0, 1.3))
    assert translation_error(refined.T_1_0, pair.geometry.T_1_0) < 0.03 * 1.8
    assert refined.refined > 0.9


def test_without_tracks_the_pose_stays():
    pair = read_pair(Wall(3), 0, 2)
    blank = replace(pair, frames=tuple(np.full_like(frame, 90) for frame in pair.frames))
    refined = refine_pose(blank)
    assert (refined.kept, refined.tracks) == (True, 0)
    np.testing.assert_array_equal(refined.T_1_0, pair.geometry.T_1_0)


def test_nothing_to_refine():
    assert refine_pose(read_pair(Wall(3, poses=False), 0, 2)) is None
    assert refine_pose(read_pair(Wall(3, depth=False), 0, 2)) is None
    pair = read_pair(Wall(3), 0, 2)
    assert with_pose(pair, None) is pair


def test_summary(flight: ImageSequence):
    pair = read_pair(flight, 3, 9)
    told = summary([refine_pose(disturbed(pair)), None])
    assert (told["pairs"], told["kept"]) == (1, 1)
    assert told["agree_given"] < told["agree_refined"]
    assert summary([None])["agree_given"] is None


def test_pair_sets_refine_if_asked(flight: ImageSequence):
    off = copy.copy(flight)
    off.pose = lambda index: np.diag([1.1, 1.1, 1.1, 1]) @ flight.pose(index) @ np.diag([1 / 1.1, 1 / 1.1, 1 / 1.1, 1])
    listed, truth = [ListedPair(0, 3, 9, 0.9)], read_pair(flight, 3, 9).geometry.T_1_0
    given = PairSet([Source([off])], listed, PoseDepthInliers())
    refining = PairSet([Source([off])], listed, PoseDepthInliers(), refine_poses=True)
    wrong = translation_error(given.read(0, True).geometry.T_1_0, truth)
    assert wrong == pytest.approx(0.1 * np.linalg.norm(truth[:3, 3]), rel=0.1)
    pair = refining.verifiable().read(0, True)
    assert translation_error(pair.geometry.T_1_0, truth) < 0.3 * wrong
    assert len(pair.frames) == 2
    assert "refined_poses" not in given.protocol
    assert refining.protocol["refined_poses"]["pairs"] == 1

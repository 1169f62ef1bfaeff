from dataclasses import replace
from importlib.metadata import version
from types import MappingProxyType

import cv2
import numpy as np
import poselib
import pytest
from stereo_scenes import CAMERA, StereoScene, squeezed, squeezed_points
from textured_scenes import keypoints

from sips_lit.errors import BadInputError
from sips_lit.geometry.image_changes import resize_camera
from sips_lit.geometry.pnp import p3p_ransac
from sips_lit.geometry.pose import PoseEstimate, rotation_error, translation_error
from sips_lit.geometry.projection import sample_depth, transfer
from sips_lit.inliers.stereo_p3p import StereoP3PInliers
from sips_lit.inliers.verification import verify
from sips_lit.pairs.sampler import read_pair
from sips_lit.train.augment import mirror_pair
from sips_lit.types import Camera, Features, FramePair, Keypoints, Matches, Reason

SCENES = {tells: StereoScene(3, tells) for tells in ("stereo", "depth")}
CHECK = StereoP3PInliers(iterations=500)


def true_points(seed: int = 0, wrong: float = 0.4) -> tuple[Keypoints, Keypoints, Matches, np.ndarray]:
    """Points that both frames 0 and 2 show, in a random order, a part of them matched wrongly; which are right."""
    scene, generator = SCENES["depth"], np.random.default_rng(seed)
    xy = cv2.goodFeaturesToTrack(scene.frames[0], 150, 1e-3, 6).reshape(-1, 2)
    depth = sample_depth(scene.depths[0], xy)
    T_1_0 = np.linalg.inv(scene.poses[2]) @ scene.poses[0]
    moved, depth_there = transfer(xy, depth, CAMERA, CAMERA, T_1_0)
    inside = ((moved > 5) & (moved < np.array(CAMERA.size) - 6)).all(1)
    seen = inside & np.isclose(sample_depth(scene.depths[2], moved), depth_there, rtol=0.02)
    xy, moved = xy[seen], moved[seen]
    right = generator.random(len(xy)) >= wrong
    moved[~right] = generator.uniform([5, 5], np.array(CAMERA.size) - 6, (int((~right).sum()), 2))
    order = generator.permutation(len(xy))
    shuffled = np.empty_like(moved)
    shuffled[order] = moved
    return keypoints(xy), keypoints(shuffled), Matches(np.arange(len(xy)), order), right


@pytest.mark.parametrize("tells", ["stereo", "depth"])
@pytest.mark.parametrize("seed", range(2))
def test_right_matches_are_inliers(tells, seed):
    points0, points1, matches, right = true_points(seed)
    inliers = CHECK(read_pair(SCENES[tells], 0, 2), points0, points1, matches)
    judged = inliers.reason != Reason.UNKNOWN
    assert judged.mean() > 0.8
    assert inliers.inlier[judged & right].mean() > 0.9
    assert inliers.inlier[~right].mean() < 0.05
    assert set(inliers.reason[judged]) <= {Reason.INLIER, Reason.FAR}
    np.testing.assert_array_equal(inliers.inlier, inliers.reason == Reason.INLIER)
    assert inliers.known0[matches.index0[judged]].all()
    assert inliers.known1[matches.index1[judged]].all()


@pytest.mark.parametrize("tells", ["stereo", "depth"])
def test_the_pose_is_found_without_knowing_any(tells):
    pair = read_pair(SCENES[tells], 0, 2)
    truth = pair.geometry.T_1_0
    unposed = replace(pair, geometry=replace(pair.geometry, T_1_0=None))
    points0, points1, matches, right = true_points()
    found = CHECK.prepare(unposed, points0, points1).estimate(matches)
    assert translation_error(found.T_1_0, truth) < 0.05
    assert rotation_error(found.T_1_0, truth) < 0.3
    assert found.inlier[~right].mean() < 0.05


def test_depth_of_one_image_suffices():
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, right = true_points()
    truth = pair.geometry.T_1_0
    for lacking in ("depth0", "depth1"):
        half = replace(pair, geometry=replace(pair.geometry, **{lacking: None}))
        inliers = CHECK(half, points0, points1, matches)
        assert inliers.inlier[right].mean() > 0.9
        assert inliers.known0.all()
        assert inliers.known1.all()
        found = CHECK.prepare(half, points0, points1).estimate(matches)
        assert translation_error(found.T_1_0, truth) < 0.05
        assert found.inlier[right].mean() > 0.9


def test_both_ways_must_agree():
    """A match that only one way's pose explains: the other image's depth at its point is wrong."""
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, right = true_points()
    motion = np.linalg.norm(points1.xy[matches.index1] - points0.xy, axis=1)
    spoilt = int(np.where(right, motion, 0).argmax())  # near the epipole depth would not matter
    for image, points, index in ((0, points0, matches.index0), (1, points1, matches.index1)):
        name = f"depth{image}"
        depth = getattr(pair.geometry, name).copy()
        x, y = np.round(points.xy[index[spoilt]]).astype(int)
        depth[y, x] *= 0.3
        inliers = CHECK(replace(pair, geometry=replace(pair.geometry, **{name: depth})), points0, points1, matches)
        assert inliers.reason[spoilt] == Reason.FAR
        assert inliers.inlier[right].mean() > 0.9


def test_matches_without_any_depth_are_ignored():
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, _ = true_points()
    holes = [np.array(depth) for depth in (pair.geometry.depth0, pair.geometry.depth1)]
    x, y = np.round(points0.xy[7]).astype(int)
    holes[0][y, x] = np.nan
    x, y = np.round(points1.xy[matches.index1[7]]).astype(int)
    holes[1][y, x] = np.nan
    holed = replace(pair, geometry=replace(pair.geometry, depth0=holes[0], depth1=holes[1]))
    inliers = CHECK(holed, points0, points1, matches)
    assert inliers.reason[7] == Reason.UNKNOWN
    assert not inliers.known0[7]
    assert not inliers.known1[matches.index1[7]]
    assert inliers.known0.sum() == len(points0) - 1


def test_a_mirror_changes_little():
    pair = read_pair(SCENES["stereo"], 0, 2)
    points0, points1, matches, right = true_points()
    size = np.array(CAMERA.size)
    turned = [keypoints((size - 1 - p.xy) * [1, 0] + p.xy * [0, 1], p.score) for p in (points0, points1)]
    inliers = CHECK(mirror_pair(pair, True, False), *turned, matches)
    judged = inliers.reason != Reason.UNKNOWN
    assert inliers.inlier[judged & right].mean() > 0.9
    assert inliers.inlier[~right].mean() < 0.05


def test_the_same_call_gives_the_same_answer_and_another_seed_other_samples():
    pair = read_pair(SCENES["stereo"], 0, 2)
    points0, points1, matches, _ = true_points(wrong=0.7)
    few = replace(CHECK, iterations=4)
    prepared = few.prepare(pair, points0, points1)
    for again in (prepared(matches), few(pair, points0, points1, matches)):
        np.testing.assert_array_equal(again.reason, prepared(matches).reason)
    counts = [prepared(matches, repeat).inlier.sum() for repeat in range(6)]
    assert len(set(counts)) > 1
    seeded = [replace(few, seed=seed)(pair, points0, points1, matches).inlier.sum() for seed in range(6)]
    assert counts == seeded


def test_other_pairs_get_other_samples():
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, _ = true_points(wrong=0.7)
    few = replace(CHECK, iterations=4)
    counts = {few(replace(pair, index0=i), points0, points1, matches).inlier.sum() for i in range(6)}
    assert len(counts) > 1


@pytest.mark.parametrize("threshold", [1.0, 3.0])
def test_inliers_project_within_the_threshold_of_the_pose(threshold):
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, _ = true_points()
    noisy = keypoints(points1.xy + np.random.default_rng(1).normal(0, 1.5, points1.xy.shape))
    found = replace(CHECK, threshold=threshold).prepare(pair, points0, noisy).estimate(matches)
    own = sample_depth(pair.geometry.depth0, points0.xy)
    moved, _ = transfer(points0.xy, own, CAMERA, CAMERA, found.T_1_0)
    error = np.linalg.norm(moved[matches.index0] - noisy.xy[matches.index1], axis=1)
    np.testing.assert_array_equal(found.inlier, error <= threshold)
    assert ((error > threshold) & (error <= 2 * threshold)).any()


def test_each_image_has_its_own_camera():
    """Image 1 is enlarged: its camera and its points are those of another size."""
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, right = true_points()
    size = (2 * CAMERA.size[0], 2 * CAMERA.size[1])
    larger = replace(pair.geometry, camera1=resize_camera(CAMERA, size), depth1=None)
    enlarged = keypoints(points1.xy * 2 + 0.5)
    found = CHECK.prepare(replace(pair, geometry=larger), points0, enlarged).estimate(matches)
    assert translation_error(found.T_1_0, pair.geometry.T_1_0) < 0.05
    assert found.inlier[right].mean() > 0.9


def test_the_number_of_samples_is_handed_on(monkeypatch):
    asked = []

    def noting(points, pixels, camera, generator, iterations, threshold):
        asked.append(iterations)
        return p3p_ransac(points, pixels, camera, generator, iterations, threshold)

    monkeypatch.setattr("sips_lit.inliers.stereo_p3p.p3p_ransac", noting)
    points0, points1, matches, _ = true_points()
    replace(CHECK, iterations=123)(read_pair(SCENES["depth"], 0, 2), points0, points1, matches)
    assert asked == [123, 123]  # both ways


@pytest.mark.parametrize("count", [0, 1, 3])
def test_too_few_matches_have_no_inliers(count):
    pair = read_pair(SCENES["stereo"], 0, 2)
    points0, points1, matches, _ = true_points()
    few = Matches(matches.index0[:count], matches.index1[:count])
    prepared = CHECK.prepare(pair, points0, points1)
    inliers = prepared(few)
    assert inliers.inlier.tolist() == [False] * count
    assert set(inliers.reason) <= {Reason.FAR, Reason.UNKNOWN}
    assert prepared.estimate(few).T_1_0 is None


def test_no_points():
    none = np.zeros(0, np.int64)
    pair = read_pair(SCENES["stereo"], 0, 2)
    inliers = CHECK(pair, Keypoints.empty(), Keypoints.empty(), Matches(none, none))
    assert len(inliers.inlier) == len(inliers.known0) == len(inliers.known1) == 0


@pytest.mark.parametrize("without", ["geometry", "depth", "baseline"])
def test_a_pair_without_depth_is_refused(without):
    pair = read_pair(SCENES["stereo"], 0, 1)
    lacking = {
        "geometry": None,
        "depth": replace(pair.geometry, right0=None, right1=None),
        "baseline": replace(pair.geometry, baseline=None),
    }[without]
    points0, points1, matches, _ = true_points()
    with pytest.raises(BadInputError, match=r"boards:0-1 has no depth maps and no stereo .* inliers=stereo_p3p needs"):
        CHECK(replace(pair, geometry=lacking), points0, points1, matches)


def test_the_search_for_n_k_prepares_once(monkeypatch):
    points0, points1, matches, right = true_points(wrong=0.2)
    descriptors = np.random.default_rng(0).normal(size=(len(points0), 8)).astype(np.float32)
    other = np.empty_like(descriptors)
    other[matches.index1] = descriptors
    features = Features(points0, descriptors, "l2"), Features(points1, other, "l2")
    pair, calls = read_pair(SCENES["stereo"], 0, 2), []
    prepare = StereoP3PInliers.prepare
    monkeypatch.setattr(StereoP3PInliers, "prepare", lambda *args: calls.append(1) or prepare(*args))
    found = verify(pair, *features, CHECK).points_needed(10, len(points0))
    assert found is not None
    assert 10 <= found < len(points0)
    assert len(calls) == 1
    assert right.sum() > 10
    with pytest.raises(BadInputError, match="search=binary"):
        verify(pair, *features, CHECK, "exact")


def test_each_direction_is_searched_with_the_camera_it_ends_in_and_the_given_limits(monkeypatch):
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, _ = true_points()
    other = Camera(CAMERA.matrix * [[1.1], [1.1], [1]], CAMERA.size)
    pair = replace(pair, geometry=replace(pair.geometry, camera1=other))
    given = []

    def search(points, pixels, camera, generator, iterations, threshold):
        given.append((camera, iterations, threshold, tuple(generator.integers(1000, size=4))))
        return PoseEstimate(None, np.zeros(len(points), np.bool_))

    monkeypatch.setattr("sips_lit.inliers.stereo_p3p.p3p_ransac", search)
    StereoP3PInliers(threshold=2.5, iterations=70, seed=3)(pair, points0, points1, matches)
    assert [camera is other for camera, *_ in given] == [True, False]
    assert [limits for _, *limits, _ in given] == [[70, 2.5]] * 2
    StereoP3PInliers(seed=3)(replace(pair, index1=pair.index1 + 1), points0, points1, matches)
    assert len({samples for *_, samples in given}) == 4  # others for each direction and each pair


def test_a_point_of_unknown_depth_never_reaches_the_search(monkeypatch):
    points0, points1, matches, _ = true_points()
    pair = read_pair(SCENES["depth"], 0, 2)
    holes = [depth.copy() for depth in (pair.geometry.depth0, pair.geometry.depth1)]
    for depth in holes:
        depth[:, ::40] = np.nan
    pair = replace(pair, geometry=replace(pair.geometry, depth0=holes[0], depth1=holes[1]))
    given = []
    search = poselib.estimate_absolute_pose
    monkeypatch.setattr(poselib, "estimate_absolute_pose", lambda *args: given.append(args[:2]) or search(*args))
    unknown = CHECK(pair, points0, points1, matches).reason == Reason.UNKNOWN
    prepared = CHECK.prepare(pair, points0, points1)
    lacking = [~side.known for side in prepared.sides]
    assert lacking[0].any()
    assert lacking[1].any()
    assert [len(points) for _, points in given] == [(~lacking[0]).sum(), (~lacking[1]).sum()]
    assert all(np.isfinite(array).all() for arrays in given for array in arrays)
    np.testing.assert_array_equal(unknown, lacking[0][matches.index0] & lacking[1][matches.index1])


def test_protocol():
    protocol = dict(StereoP3PInliers().protocol)
    assert protocol.pop("stereo")["max_roundtrip"] == 1.0
    assert protocol.pop("estimator") == f"P3P in LO-RANSAC, PoseLib {version('poselib')}"
    assert protocol == {"inliers": "stereo_p3p", "threshold": 3.0, "iterations": 3000, "seed": 0}
    assert not CHECK.independent
    assert CHECK.uses_depth
    assert not CHECK.uses_frames
    assert isinstance(read_pair(SCENES["stereo"], 0, 1), FramePair)


@pytest.mark.parametrize("tells", ["stereo", "depth"])
def test_the_pose_is_in_metres_where_focal_lengths_differ(tells):
    pair = read_pair(SCENES[tells], 0, 2)
    points0, points1, matches, right = true_points()
    low = [keypoints(squeezed_points(points.xy)) for points in (points0, points1)]
    found = CHECK.prepare(squeezed(pair), *low).estimate(matches)
    assert translation_error(found.T_1_0, pair.geometry.T_1_0) < 0.05
    assert rotation_error(found.T_1_0, pair.geometry.T_1_0) < 0.3
    assert found.inlier[~right].mean() < 0.05


def test_the_depth_of_image_1_is_seen_by_its_own_camera():
    """Image 1 is twice as large, and only it has depth."""
    pair = read_pair(SCENES["depth"], 0, 2)
    points0, points1, matches, right = true_points()
    camera = Camera(np.array([[500.0, 0, 320.5], [0, 500, 240.5], [0, 0, 1]]), (640, 480))
    depth = np.repeat(np.repeat(pair.geometry.depth1, 2, 0), 2, 1)
    larger = replace(pair, geometry=replace(pair.geometry, camera1=camera, depth0=None, depth1=depth))
    found = CHECK.prepare(larger, points0, keypoints(points1.xy * 2 + 0.5)).estimate(matches)
    assert translation_error(found.T_1_0, pair.geometry.T_1_0) < 0.05
    assert found.inlier[right].mean() > 0.9


@pytest.mark.parametrize(("lacking", "usable"), [(None, 2), ("depth0", 1), ("depth1", 2)])
def test_usable_are_matches_whose_point_has_a_depth_where_the_pose_is_sought(lacking, usable):
    """Four matches: the last two points of image 0 and the last three of image 1 have no depth."""
    pair = read_pair(SCENES["depth"], 0, 2)
    holes = [np.full(depth.shape, 3, np.float32) for depth in (pair.geometry.depth0, pair.geometry.depth1)]
    holes[0][:, 25:], holes[1][:, 15:] = np.nan, np.nan
    geometry = replace(pair.geometry, depth0=holes[0], depth1=holes[1])
    if lacking:
        geometry = replace(geometry, **{lacking: None})
    points = keypoints([[10, 50], [20, 50], [30, 50], [40, 50]])
    turned = Matches(np.array([3, 2, 1, 0]), np.array([3, 2, 1, 0]))
    assert CHECK.prepare(replace(pair, geometry=geometry), points, points).usable(turned) == usable


class Constant:
    """A stereo matcher that sees everything at one disparity."""

    parameters = MappingProxyType({"of": "a test"})

    def disparity(self, image, partner, xy, to_the_right=True):
        return np.full(len(xy), 20.0)


def test_the_matcher_that_is_given_tells_the_depth():
    pair = read_pair(SCENES["stereo"], 0, 2)
    check = replace(CHECK, stereo=Constant())
    points = keypoints([[50, 60], [70, 80]])
    for side in check.prepare(pair, points, points).sides:
        np.testing.assert_allclose(side.points[:, 2], 250 * 0.4 / 20)
    assert check.protocol["stereo"] == {"of": "a test"}

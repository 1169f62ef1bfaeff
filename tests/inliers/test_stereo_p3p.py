from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pytest
from stereo_points import SCENES, true_points
from stereo_scenes import CAMERA
from textured_scenes import keypoints

from sips_lit.errors import BadInputError
from sips_lit.geometry.pnp import p3p_ransac
from sips_lit.geometry.pose import rotation_error, translation_error
from sips_lit.geometry.projection import sample_depth, transfer
from sips_lit.inliers.stereo_p3p import StereoP3PInliers
from sips_lit.inliers.verification import verify
from sips_lit.pairs.sampler import read_pair
from sips_lit.types import Features, FramePair, Keypoints, Matches, Reason

CHECK = StereoP3PInliers(iterations=500)


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


def test_protocol():
    protocol = dict(StereoP3PInliers().protocol)
    assert protocol.pop("stereo")["max_roundtrip"] == 1.0
    assert protocol.pop("estimator") == f"P3P in LO-RANSAC, PoseLib {version('poselib')}"
    assert protocol == {"inliers": "stereo_p3p", "threshold": 3.0, "iterations": 3000, "seed": 0}
    assert not CHECK.independent
    assert CHECK.uses_depth
    assert not CHECK.uses_frames
    assert isinstance(read_pair(SCENES["stereo"], 0, 1), FramePair)

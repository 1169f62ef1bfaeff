import dataclasses
import math

import numpy as np
import pytest
from textured_scenes import film, flight
from wall_scene import Wall

from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.baselines.sift import SiftDetector
from sips_lit.describe.sift import RootSift
from sips_lit.errors import BadInputError
from sips_lit.evaluate.features import extract
from sips_lit.evaluate.measure import measure_pair
from sips_lit.evaluate.measures import Measures
from sips_lit.geometry.projection import sample_depth
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.klt import KltInliers
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.inliers.stereo_p3p import StereoP3PInliers
from sips_lit.matching.mutual_nearest import distances, mutual_nearest
from sips_lit.pairs.sampler import read_pair
from sips_lit.types import Features, Keypoints

M = Measures(k=10, ks=(5,), n_max=80, n=50, budgets=(20,), repeats=3, iterations=100)


def points(pair, detector=None, n=80):
    return [extract(detector or ShiTomasi(), RootSift(), image, n).features for image in (pair.image0, pair.image1)]


@pytest.mark.parametrize("detector", [ShiTomasi(), SiftDetector()], ids=["corners", "sift"])
@pytest.mark.parametrize("check", [PoseDepthInliers(), KltInliers()], ids=["pose_depth", "klt"])
def test_n_k_by_its_definition(detector, check):
    """Crop, match and verify anew for every n."""
    pair = read_pair(Wall(6), 0, 3)
    both = points(pair, detector)
    counts = []
    for n in range(81):
        best = [features.best(n) for features in both]
        matches = mutual_nearest(distances(*best))
        counts.append(int(check(pair, best[0].keypoints, best[1].keypoints, matches).inlier.sum()))
    measured = measure_pair(pair, *both, check, M)
    for column, k in enumerate(M.every_k):
        enough = [n for n in range(81) if counts[n] >= k]
        assert measured.n_k[0, column] == (enough[0] if enough else math.inf)
    assert measured.budgets[20].inliers.tolist() == [counts[20]]
    assert measured.budgets[50].inliers.tolist() == [counts[50]]


@pytest.mark.parametrize("stereo", [False, True])
def test_known_geometry(stereo):
    """A wall, true poses: the corners are found again, the matches are right, the pose is found."""
    pair = read_pair(Wall(6, depth=not stereo, stereo=stereo), 0, 2, between=False)
    measured = measure_pair(pair, *points(pair), PoseDepthInliers(), M)
    at = measured.budgets[50]
    assert at.matching_score <= at.repeatability
    assert at.repeatability > 0.6
    assert (at.rotation_error < 0.3).all()
    assert (at.translation_error < 0.1).all()
    assert np.isfinite(measured.rotation_error).all()
    assert set(measured.milliseconds) == {"match", "verify", "metrics"}


def test_random_verification_is_repeated():
    pair = read_pair(Wall(6, poses=False, depth=False, stereo=True), 0, 2, between=False)
    both = points(pair)
    measured = measure_pair(pair, *both, StereoP3PInliers(), M)
    assert measured.n_k.shape == (3, 2)
    assert (measured.n_k[:, 0] <= measured.n_k[:, 1]).all()
    assert np.isfinite(measured.n_k).all()
    assert np.isnan(measured.rotation_error).all()  # nobody knows the poses
    assert math.isnan(measured.budgets[20].repeatability)
    again = measure_pair(pair, *both, StereoP3PInliers(), M)
    np.testing.assert_array_equal(measured.n_k, again.n_k)
    exact = measure_pair(read_pair(Wall(6), 0, 2), *both, PoseDepthInliers(), M)
    assert abs(np.median(measured.n_k[:, 1]) - exact.n_k[0, 1]) <= 5


def test_its_pose_is_compared_where_the_true_one_is_known():
    pair = read_pair(Wall(6, depth=False, stereo=True), 0, 2, between=False)
    measured = measure_pair(pair, *points(pair), StereoP3PInliers(), M)
    assert (measured.translation_error < 1).all()
    assert measured.budgets[50].translation_error.shape == (3,)
    assert (measured.budgets[50].translation_error < 0.1).all()


def test_poses_may_be_left_out():
    pair = read_pair(Wall(6), 0, 2)
    measured = measure_pair(pair, *points(pair), PoseDepthInliers(), Measures(pose=False))
    assert np.isnan(measured.rotation_error).all()


def test_images_without_points():
    pair = read_pair(Wall(6), 0, 2)
    both = [features.best(0) for features in points(pair)]
    for check in (PoseDepthInliers(), StereoP3PInliers(), KltInliers()):
        measured = measure_pair(pair, *both, check, M)
        assert np.isinf(measured.n_k).all()
        assert np.isinf(measured.n_k_judged).all()
        assert math.isnan(measured.unknown)
        assert np.isinf(measured.translation_error).all()
        at = measured.budgets[50]
        assert (at.matches, at.spread, at.repeatability) == (0, 0, 0)
        assert not at.inliers.any()


def test_points_on_one_side_and_fewer_than_asked():
    pair = read_pair(Wall(6), 0, 2)
    first, second = points(pair)
    for both in ((first.best(0), second), (first.best(3), second), (first, second.best(3))):
        measured = measure_pair(pair, *both, PoseDepthInliers(), M)
        assert np.isinf(measured.n_k).all()
        assert measured.budgets[50].matches <= 3


def test_no_depth_anywhere():
    """Depth maps without a single value: nothing is known, nothing is an inlier."""
    wall = Wall(6)
    wall.depth = lambda index: np.full((120, 160), np.nan, np.float32)
    pair = read_pair(wall, 0, 2)
    for check in (PoseDepthInliers(), StereoP3PInliers()):
        measured = measure_pair(pair, *points(pair), check, M)
        assert np.isinf(measured.n_k).all()
        assert np.isinf(measured.budgets[50].translation_error).all()
        assert math.isnan(measured.budgets[50].repeatability)
        assert np.isinf(measured.n_k_judged).all()
        assert measured.unknown == 1


def half_known(pair):
    """Depth maps that lack the left part in image 0, and so in image 1 another part of the wall."""
    depth0, depth1 = pair.geometry.depth0.copy(), pair.geometry.depth1.copy()
    depth0[:, :60] = depth1[:, :60] = np.nan
    return dataclasses.replace(pair, geometry=dataclasses.replace(pair.geometry, depth0=depth0, depth1=depth1))


@pytest.mark.parametrize("check", [PoseDepthInliers(), StereoP3PInliers()], ids=["pose_depth", "stereo_p3p"])
@pytest.mark.parametrize("scores", ["order", "probability", "none"])
def test_unknown_points_are_left_out_of_judged_n_k_alone(check, scores):
    """More points than n_max are given: those of probabilities beyond it count in calibration only."""
    pair = half_known(read_pair(Wall(6), 0, 2))
    m = dataclasses.replace(M, n_max=60)
    both = points(pair)
    measured = measure_pair(pair, *both, check, m, scores)
    judged = []
    best = [features.best(60) for features in both]
    matches = [mutual_nearest(distances(*(f.best(n) for f in best))) for n in range(61)]
    prepared = check.prepare(pair, *(f.keypoints for f in best))
    answers = [prepared(of_n) for of_n in matches]
    for side, features in zip(("known0", "known1"), best, strict=True):
        known = np.any([getattr(answer, side) for answer in answers], axis=0)
        judged.append(
            Features(
                Keypoints(*(getattr(features.keypoints, name)[known] for name in ("xy", "score", "scale"))),
                features.descriptors[known],
                "l2",
            )
        )
    expected = measure_pair(pair, *judged, check, m, scores)
    np.testing.assert_array_equal(measured.n_k_judged, expected.n_k)
    assert measured.unknown == 1 - sum(map(len, judged)) / 120
    assert 0.1 < measured.unknown < 0.5
    if scores == "order":
        assert np.isfinite(measured.n_k).all()
        assert (measured.n_k_judged < measured.n_k).all()
    assert set(measured.milliseconds) == {"match", "verify", "metrics"}


def test_all_n_k_are_one_where_everything_is_known():
    pair = read_pair(Wall(6), 0, 2)
    for check in (PoseDepthInliers(), StereoP3PInliers(), KltInliers()):
        measured = measure_pair(pair, *points(pair), check, M, "probability")
        np.testing.assert_array_equal(measured.n_k_judged, measured.n_k)
        assert measured.unknown == 0


def test_planar_scenes():
    pair = read_pair(flight(4), 0, 3)
    measured = measure_pair(pair, *points(pair), HomographyInliers(), M)
    assert measured.budgets[50].repeatability > 0.5
    assert np.isnan(measured.budgets[50].rotation_error).all()
    unknown = read_pair(film(4), 0, 3)
    assert math.isnan(measure_pair(unknown, *points(pair), KltInliers(), M).budgets[50].repeatability)


class Together(HomographyInliers):
    """Verifies all matches together, in its own way: none is an inlier unless there are twelve."""

    independent = False

    def __call__(self, pair, keypoints0, keypoints1, matches):
        found = super().__call__(pair, keypoints0, keypoints1, matches)
        return found if len(matches) >= 12 else dataclasses.replace(found, inlier=np.zeros(len(matches), bool))


def test_other_checks_that_verify_all_matches_together():
    pair = read_pair(flight(4), 0, 3)
    measured = measure_pair(pair, *points(pair), Together(), M)
    alone = measure_pair(pair, *points(pair), HomographyInliers(), M)
    assert measured.n_k.shape == (3, 2)  # its repeats agree: it draws nothing
    assert (measured.n_k == measured.n_k[0]).all()
    assert (measured.n_k[0] >= alone.n_k[0]).all()
    assert measured.n_k[0, 0] >= 12 > alone.n_k[0, 0]
    with pytest.raises(BadInputError, match="inliers=homography verifies all matches of a budget together"):
        measure_pair(pair, *points(pair), Together(), dataclasses.replace(M, search="exact"))


def test_halving_agrees_where_inliers_only_grow():
    pair = read_pair(flight(4), 0, 3)
    both = points(pair)
    counts = []
    for n in range(81):
        best = [features.best(n) for features in both]
        matches = mutual_nearest(distances(*best))
        counts.append(int(HomographyInliers()(pair, best[0].keypoints, best[1].keypoints, matches).inlier.sum()))
    exact, binary = (
        measure_pair(pair, *both, HomographyInliers(), dataclasses.replace(M, search=search))
        for search in ("exact", "binary")
    )
    grows = [all(np.diff(np.array(counts) >= k) >= 0) for k in M.every_k]
    assert any(grows)
    np.testing.assert_array_equal(binary.n_k[0, grows], exact.n_k[0, grows])
    assert (binary.budgets[50].matches, binary.budgets[50].inliers) == (exact.budgets[50].matches, counts[50])


def test_depth_that_the_keypoints_bring_is_taken():
    """Nobody looks at the maps any more: spoilt ones make no difference."""
    wall = Wall(6)
    pair = read_pair(wall, 0, 2)
    both = points(pair)
    brought = [
        dataclasses.replace(
            f, keypoints=dataclasses.replace(f.keypoints, depth=sample_depth(wall.depth(i), f.keypoints.xy))
        )
        for f, i in zip(both, (0, 2), strict=True)
    ]
    spoilt = dataclasses.replace(pair.geometry, depth0=pair.geometry.depth0 * 3, depth1=None)
    for check in (PoseDepthInliers(occlusion=0.999), StereoP3PInliers()):
        expected = measure_pair(pair, *both, check, M)
        measured = measure_pair(dataclasses.replace(pair, geometry=spoilt), *brought, check, M)
        np.testing.assert_array_equal(measured.n_k, expected.n_k)
        np.testing.assert_array_equal(measured.translation_error, expected.translation_error)

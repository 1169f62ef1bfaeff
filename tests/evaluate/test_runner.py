import json
import math
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
import torch
from textured_scenes import ArraySequence
from tiny_methods import MEASURES, METHODS, method, run_methods
from wall_scene import Wall

from sips_lit.baselines.controls import RandomPoints
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.describe.sift import RootSift
from sips_lit.errors import BadInputError
from sips_lit.evaluate.features import extract
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.evaluate.runner import search_used, versions
from sips_lit.frames.source import Source
from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.inliers.stereo_p3p import StereoP3PInliers
from sips_lit.matching.mutual_nearest import distances, mutual_nearest
from sips_lit.pairs.choice import ListedPair
from sips_lit.report.summary import succinctness


def cropped_inliers(pair, check, method, n_max):
    """Inliers of the n best points for n = 0 ... n_max, matched and verified anew each time: the definition."""
    features = [extract(method.detector, method.descriptor, i, n_max).features for i in (pair.image0, pair.image1)]
    counts = []
    for n in range(n_max + 1):
        best = [f.best(n) for f in features]
        matches = mutual_nearest(distances(*best))
        counts.append(int(check(pair, best[0].keypoints, best[1].keypoints, matches).inlier.sum()))
    return counts


@pytest.mark.parametrize("number", [1, 2, 3], ids=["corners", "orb", "sift"])
def test_n_k_by_its_definition(measured_flights, number):
    pairs, results = measured_flights
    result = results[number]
    assert list(result.pairs.name) == [pairs.read(at, depth=False).name for at in range(len(pairs))]
    for at in range(len(pairs)):
        counts = cropped_inliers(pairs.read(at, depth=False), pairs.check(at), METHODS[number], 60)
        for column, k in enumerate((5, 8)):
            enough = [n for n in range(61) if counts[n] >= k]
            assert result.n_k[at, 0, column] == (enough[0] if enough else math.inf)
        assert result.budgets[20].inliers[at] == counts[20]
    failed = int(np.isinf(result.n_k[:, 0, 1]).sum())
    assert succinctness(result, 8).failures == failed


def test_the_same_result_twice(flights, measured_flights):
    sequences, listed = flights
    pairs = PairSet([Source(sequences)], listed, HomographyInliers())
    for again, before in zip(run_methods(METHODS, pairs, MEASURES), measured_flights[1], strict=True):
        np.testing.assert_array_equal(again.n_k, before.n_k)
        np.testing.assert_array_equal(again.budgets[20].matches, before.budgets[20].matches)
        np.testing.assert_array_equal(again.budgets[20].spread, before.budgets[20].spread)


def test_halving(flights, measured_flights):
    sequences, listed = flights
    pairs = PairSet([Source(sequences)], listed, HomographyInliers())
    binary = run_methods(METHODS[1:2], pairs, replace(MEASURES, search="binary"))[0]
    exact = measured_flights[1][1]
    assert (binary.protocol["search"], exact.protocol["search"]) == ("binary", "exact")
    assert (binary.n_k >= exact.n_k).all()
    np.testing.assert_array_equal(binary.budgets[20].inliers, exact.budgets[20].inliers)


def test_the_search_that_is_used(flights):
    sequences, listed = flights
    sources = [Source(sequences[:1], inliers=StereoP3PInliers()), Source(sequences[1:])]
    pairs = PairSet(sources, listed, HomographyInliers())
    assert search_used(MEASURES, pairs) == "binary and exact"
    assert search_used(replace(MEASURES, search="binary"), pairs) == "binary"


def test_the_protocol_is_complete(flights, measured_flights):
    sequences, listed = flights
    pairs = PairSet(
        [Source(sequences)], listed, HomographyInliers(), chosen={"kind": "random", "overlap": 0.5, "seed": 0}
    )
    p = run_methods(METHODS[:1], pairs, MEASURES)[0].protocol
    assert {name: p[name] for name in ("k", "n", "n_max", "search", "seed", "pairs", "overlap", "kind")} == {
        "k": 8,
        "n": 20,
        "n_max": 60,
        "search": "exact",
        "seed": 0,
        "pairs": 6,
        "overlap": 0.5,
        "kind": "random",
    }
    assert (p["detector"], p["descriptor"], p["scores"]) == ("SIPs", RootSift().name, "probability")
    assert p["sequences"] == ["a", "b"]
    assert p["verification"][0]["threshold"] == 3.0
    assert p["versions"] == versions()
    assert set(versions()) >= {"sips_lit", "torch", "opencv", "numpy", "poselib"}
    assert [(r.protocol["descriptor"], r.protocol["scores"]) for r in measured_flights[1][1:3]] == [
        ("RootSIFT", "order"),
        ("own", "order"),
    ]


def test_images_without_any_point():
    grey = ArraySequence([np.full((60, 70), 90, np.uint8)] * 4, "grey", [np.eye(3)] * 4)
    pairs = PairSet([Source([grey])], [ListedPair(0, 0, i, 1) for i in (1, 2, 3)], HomographyInliers())
    (result,) = run_methods(METHODS[1:2], pairs, MEASURES)
    assert np.isinf(result.n_k).all()
    assert (result.points0.tolist(), result.budgets[20].inliers.tolist()) == ([0] * 3, [[0]] * 3)
    assert (succinctness(result, 8).auc, succinctness(result, 8).failures) == (0, 3)


def test_points_need_a_descriptor(flights):
    sequences, listed = flights
    pairs = PairSet([Source(sequences)], listed, HomographyInliers())
    told = {}
    assert not run_methods([method(ShiTomasi(), None, "bare")], pairs, MEASURES, on_skip=told.__setitem__)
    assert "does not describe them: choose descriptor=" in told["bare"]


class CountingMatcher(StereoMatcher):
    """Counts the points of which it finds the disparity."""

    calls: ClassVar[list[int]] = []

    def disparity(self, image, partner, xy, to_the_right=True):
        self.calls.append(len(xy))
        return StereoMatcher.disparity(self, image, partner, xy, to_the_right)


@pytest.mark.parametrize("check", [PoseDepthInliers, StereoP3PInliers])
def test_depth_is_found_once_per_frame_and_method(check):
    """Verification, poses and repeatability of three pairs of three frames share it."""
    wall = Wall(6, depth=False, stereo=True)
    listed = [ListedPair(0, 0, 2, 1), ListedPair(0, 2, 4, 1), ListedPair(0, 0, 4, 1)]
    CountingMatcher.calls.clear()
    pairs = PairSet([Source([wall])], listed, check(stereo=CountingMatcher()))
    (result,) = run_methods(METHODS[1:2], pairs, MEASURES)
    assert len(CountingMatcher.calls) == 3
    assert result.milliseconds["depth"] > 0
    assert (result.budgets[20].translation_error[:2] < 0.3).all()
    assert (result.budgets[20].repeatability > 0.3).all()


def test_the_papers_formula(measured_flights):
    """s(n) and AUC-n_max written out: the integral of a step function from 0 to n_max, by its n_max unit steps."""
    for result in measured_flights[1]:
        n_k = result.n_k[:, 0, 1]
        area = sum(sum(needed <= n for needed in n_k) / len(n_k) for n in range(60)) / 60
        assert succinctness(result, 8).auc == pytest.approx(area, abs=1e-12)


def test_shapes_and_protocol(measured_flights):
    for result in measured_flights[1]:
        assert result.n_k.shape == result.rotation_error.shape == (6, 1, 2)
        assert result.ks == (5, 8)
        assert result.points0.max() <= 60
        assert result.budgets[20].matches.shape == (6,)
        assert result.protocol["ks"] == [5, 8]
        assert result.protocol["versions"]["torch"] == torch.__version__
        assert result.protocol["verification"] == [dict(HomographyInliers().protocol)]
        assert result.protocol["image_size"] == ["100x90", "160x120"]
        assert result.defects["images"] > 0
        assert result.milliseconds["detect"] > 0


def test_probabilities_are_calibrated_with_more_points(measured_flights):
    by_key = {result.key: result for result in measured_flights[1]}
    assert by_key["sips"].protocol["extracted"] == 90
    assert by_key["orb"].protocol["extracted"] == 60
    assert set(by_key["sips"].calibration) == {20, 90}
    assert not by_key["orb"].calibration
    assert by_key["sips"].calibration[20].points == 6 * 2 * 20
    assert by_key["sips"].calibration[90].points > 6 * 2 * 60


def test_the_same_again_from_the_cache(flights, measured_flights, benchmark_folder):
    class Gone(ShiTomasi):
        def detect(self, image, n):
            raise AssertionError("detected again")

    sequences, listed = flights
    pairs = PairSet([Source(sequences)], listed, HomographyInliers())
    (again,) = run_methods(
        [method(Gone(), RootSift(), "corners")], pairs, MEASURES, benchmark_folder / "features", workers=1
    )
    before = measured_flights[1][1]
    np.testing.assert_array_equal(again.n_k, before.n_k)
    assert again.milliseconds["detect"] == before.milliseconds["detect"]
    assert again.defects == before.defects


def test_known_poses(benchmark_folder):
    pairs = PairSet([Source([Wall(6)])], [ListedPair(0, 0, 2, 0.9), ListedPair(0, 4, 1, math.nan)], PoseDepthInliers())
    good, control = run_methods(
        [method(ShiTomasi(), RootSift(), "wall"), method(RandomPoints(), RootSift(), "random")],
        pairs,
        MEASURES,
        benchmark_folder / "wall",
    )
    assert (good.budgets[20].translation_error < 0.3).all()
    assert (good.n_k[:, 0, 0] <= control.n_k[:, 0, 0]).all()
    assert np.isinf(control.budgets[20].translation_error).all()  # fewer than ten inliers


def test_frames_are_read_once_for_all_methods(benchmark_folder):
    wall = Wall(6)
    pairs = PairSet([Source([wall])], [ListedPair(0, 0, 2, 1), ListedPair(0, 2, 4, 1)], PoseDepthInliers())
    run_methods(METHODS[1:], pairs, MEASURES, benchmark_folder / "once")
    assert wall.reads == 3


class Failing(ShiTomasi):
    def detect(self, image, n):
        raise BadInputError("no weights for this")


def test_a_method_that_fails_is_left_out(flights, benchmark_folder):
    sequences, listed = flights
    pairs = PairSet([Source(sequences)], listed, HomographyInliers())
    told = {}
    good = METHODS[1]
    left = run_methods(
        [method(Failing(), RootSift(), "failing"), good],
        pairs,
        MEASURES,
        benchmark_folder / "features",
        on_skip=told.__setitem__,
    )
    assert [result.key for result in left] == ["corners"]
    assert told == {"failing": "no weights for this"}


def test_an_unreadable_frame_is_refused(benchmark_folder):
    wall = Wall(6)

    def broken(index):
        raise BadInputError("frame 2 is damaged")

    wall.frame = broken
    pairs = PairSet([Source([wall])], [ListedPair(0, 0, 2, 1)], PoseDepthInliers())
    with pytest.raises(BadInputError, match="is damaged"):
        run_methods(METHODS[1:2], pairs, MEASURES, benchmark_folder / "damaged")


def test_verification_that_the_data_can_not_give(benchmark_folder):
    pairs = PairSet([Source([Wall(6, poses=False)])], [ListedPair(0, 0, 2, 1)], PoseDepthInliers())
    with pytest.raises(BadInputError, match="has no pose"):
        run_methods(METHODS[1:2], pairs, MEASURES, benchmark_folder / "none")


def test_times_are_means_over_the_images(flights, tmp_path):
    sequences, listed = flights
    pairs = PairSet([Source(sequences)], listed, HomographyInliers())
    (result,) = run_methods(METHODS[1:2], pairs, MEASURES, tmp_path)
    stored = [json.loads(str(np.load(path)["about"]))["milliseconds"] for path in tmp_path.rglob("*.npz")]
    assert len(stored) == len(pairs.frames()) > 1
    for stage in ("detect", "describe"):
        assert result.milliseconds[stage] == pytest.approx(np.mean([times[stage] for times in stored]))

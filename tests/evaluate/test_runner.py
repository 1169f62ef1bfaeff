import math

import numpy as np
import pytest
import torch
from tiny_methods import MEASURES, METHODS, method
from wall_scene import Wall

from sips_lit.baselines.controls import RandomPoints
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.describe.sift import RootSift
from sips_lit.errors import BadInputError
from sips_lit.evaluate.evaluation import evaluate
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.evaluate.pairs import draw_pairs
from sips_lit.evaluate.runner import run_methods
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.pairs.pair_file import ListedPair
from sips_lit.report.summary import succinctness


def test_the_same_numbers_as_an_evaluation(flights, measured_flights, benchmark_folder):
    """The curve and the AUC are those of sips-evaluate on the same pairs."""
    pairs = draw_pairs(flights[0], HomographyInliers(), benchmark_folder / "indexes", 6)
    for who, result in zip(METHODS, measured_flights[1], strict=True):
        expected = evaluate(who.detector, who.descriptor, pairs, k=8, n_max=60)
        needed = [None if math.isinf(n) else int(n) for n in result.n_k[:, 0, 1]]
        assert needed == [row.n_k for row in expected.rows]
        ours = succinctness(result, 8)
        np.testing.assert_array_equal(ours.curve, expected.succinctness.curve)
        assert (ours.auc, ours.failures) == (expected.succinctness.auc, expected.succinctness.failures)
        assert list(result.pairs.name) == [row.pair for row in expected.rows]
        if expected.calibration is None:
            assert not result.calibration


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

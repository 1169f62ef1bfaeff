import math

import numpy as np
import pytest
import torch
from textured_scenes import flight
from wall_scene import Wall

from sips_lit.baselines.controls import RandomPoints
from sips_lit.baselines.orb import Orb
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.baselines.sift import Sift
from sips_lit.describe.sift import RootSift
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.evaluate.benchmark import run_contenders
from sips_lit.evaluate.benchmark_pairs import BenchmarkPairs
from sips_lit.evaluate.benchmark_pictures import draw_benchmark_pictures
from sips_lit.evaluate.benchmark_result import PairSetResult
from sips_lit.evaluate.benchmark_table import protocol_line, table
from sips_lit.evaluate.contender import Contender
from sips_lit.evaluate.evaluation import evaluate
from sips_lit.evaluate.measure import Measures
from sips_lit.evaluate.pair_choice import choose_pairs
from sips_lit.evaluate.pair_file import ListedPair
from sips_lit.evaluate.pairs import draw_pairs
from sips_lit.evaluate.report.summary import succinctness, summary
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.pose_depth import PoseDepthInliers

M = Measures(ks=(5, 8), n_max=60, budgets=(20,), calibration=(20, 90), iterations=100)


def sips() -> SipsDetector:
    torch.manual_seed(0)
    return SipsDetector(ScoreNetwork(3, 4), PointSelector())


def contender(detector, descriptor=None, key="it") -> Contender:
    return Contender(key, key.title(), detector, descriptor, {"key": key})


CONTENDERS = [
    contender(sips(), RootSift(), "sips"),
    contender(ShiTomasi(), RootSift(), "corners"),
    contender(Orb(), None, "orb"),
    contender(Sift(), None, "sift"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("benchmark")


@pytest.fixture(scope="module")
def flights(folder):
    sequences = [flight(8, size=(160, 120), name="a"), flight(6, size=(100, 90), seed=2, name="b")]
    return sequences, choose_pairs([Source(sequences)], folder / "indexes", pairs=6)


@pytest.fixture(scope="module")
def results(flights, folder):
    sequences, listed = flights
    pairs = BenchmarkPairs([Source(sequences)], listed, HomographyInliers())
    return pairs, run_contenders(CONTENDERS, pairs, M, folder / "features")


def test_the_same_numbers_as_an_evaluation(flights, results, folder):
    """The curve and the AUC are those of sips-evaluate on the same pairs."""
    pairs = draw_pairs(flights[0], HomographyInliers(), folder / "indexes", 6)
    for who, result in zip(CONTENDERS, results[1], strict=True):
        expected = evaluate(who.detector, who.descriptor, pairs, k=8, n_max=60)
        needed = [None if math.isinf(n) else int(n) for n in result.n_k[:, 0, 1]]
        assert needed == [row.n_k for row in expected.rows]
        ours = succinctness(result, 8)
        np.testing.assert_array_equal(ours.curve, expected.succinctness.curve)
        assert (ours.auc, ours.failures) == (expected.succinctness.auc, expected.succinctness.failures)
        assert list(result.pairs.name) == [row.pair for row in expected.rows]
        if expected.calibration is None:
            assert not result.calibration


def test_the_papers_formula(results):
    """s(n) and AUC-n_max written out: the integral of a step function from 0 to n_max, by its n_max unit steps."""
    for result in results[1]:
        n_k = result.n_k[:, 0, 1]
        area = sum(sum(needed <= n for needed in n_k) / len(n_k) for n in range(60)) / 60
        assert succinctness(result, 8).auc == pytest.approx(area, abs=1e-12)


def test_shapes_and_protocol(results):
    for result in results[1]:
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


def test_probabilities_are_calibrated_with_more_points(results):
    by_key = {result.key: result for result in results[1]}
    assert by_key["sips"].protocol["extracted"] == 90
    assert by_key["orb"].protocol["extracted"] == 60
    assert set(by_key["sips"].calibration) == {20, 90}
    assert not by_key["orb"].calibration
    assert by_key["sips"].calibration[20].points == 6 * 2 * 20
    assert by_key["sips"].calibration[90].points > 6 * 2 * 60


def test_the_same_again_from_the_cache(flights, results, folder):
    class Gone(ShiTomasi):
        def detect(self, image, n):
            raise AssertionError("detected again")

    sequences, listed = flights
    pairs = BenchmarkPairs([Source(sequences)], listed, HomographyInliers())
    (again,) = run_contenders([contender(Gone(), RootSift(), "corners")], pairs, M, folder / "features", workers=1)
    before = results[1][1]
    np.testing.assert_array_equal(again.n_k, before.n_k)
    assert again.milliseconds["detect"] == before.milliseconds["detect"]
    assert again.defects == before.defects


def test_known_poses(folder):
    pairs = BenchmarkPairs(
        [Source([Wall(6)])], [ListedPair(0, 0, 2, 0.9), ListedPair(0, 4, 1, math.nan)], PoseDepthInliers()
    )
    table = pairs.table()
    np.testing.assert_allclose(table.rotation, 0, atol=1e-6)
    np.testing.assert_allclose(table.translation, [math.hypot(1.6, 0.8), math.hypot(2.4, 1.2)], rtol=1e-9)
    assert table.name == ("wall:0-2", "wall:4-1")
    good, control = run_contenders(
        [contender(ShiTomasi(), RootSift(), "wall"), contender(RandomPoints(), RootSift(), "random")],
        pairs,
        M,
        folder / "wall",
    )
    assert (good.budgets[20].translation_error < 0.3).all()
    assert (good.n_k[:, 0, 0] <= control.n_k[:, 0, 0]).all()
    assert np.isinf(control.budgets[20].translation_error).all()  # fewer than ten inliers


def test_frames_are_read_once_for_all_contenders(folder):
    wall = Wall(6)
    pairs = BenchmarkPairs([Source([wall])], [ListedPair(0, 0, 2, 1), ListedPair(0, 2, 4, 1)], PoseDepthInliers())
    run_contenders(CONTENDERS[1:], pairs, M, folder / "once")
    assert wall.reads == 3


class Failing(ShiTomasi):
    def detect(self, image, n):
        raise BadInputError("no weights for this")


def test_a_contender_that_fails_is_left_out(flights, folder):
    sequences, listed = flights
    pairs = BenchmarkPairs([Source(sequences)], listed, HomographyInliers())
    told = {}
    good = CONTENDERS[1]
    left = run_contenders(
        [contender(Failing(), RootSift(), "failing"), good], pairs, M, folder / "features", on_skip=told.__setitem__
    )
    assert [result.key for result in left] == ["corners"]
    assert told == {"failing": "no weights for this"}


def test_an_unreadable_frame_is_refused(folder):
    wall = Wall(6)

    def broken(index):
        raise BadInputError("frame 2 is damaged")

    wall.frame = broken
    pairs = BenchmarkPairs([Source([wall])], [ListedPair(0, 0, 2, 1)], PoseDepthInliers())
    with pytest.raises(BadInputError, match="is damaged"):
        run_contenders(CONTENDERS[1:2], pairs, M, folder / "damaged")


def test_verification_that_the_data_can_not_give(folder):
    pairs = BenchmarkPairs([Source([Wall(6, poses=False)])], [ListedPair(0, 0, 2, 1)], PoseDepthInliers())
    with pytest.raises(BadInputError, match="has no pose"):
        run_contenders(CONTENDERS[1:2], pairs, M, folder / "none")


def test_no_pairs():
    with pytest.raises(BadInputError, match="no pairs"):
        BenchmarkPairs([Source([Wall(6)])], [], PoseDepthInliers())


def test_each_source_has_its_own_check(flights, folder):
    sequences, listed = flights
    sources = [Source(sequences[:1], inliers=HomographyInliers(1.5)), Source(sequences[1:])]
    pairs = BenchmarkPairs(sources, listed, HomographyInliers(3.0))
    assert {pairs.listed[at].sequence: pairs.check(at).threshold for at in range(len(pairs))} == {0: 1.5, 1: 3.0}


def test_the_table(results):
    pairs, measured = results
    drawn = {"kind": "random", "overlap": 0.5, "seed": 0}
    result = PairSetResult("set", "Set", {**pairs.protocol, **drawn}, tuple(measured), {})
    lines = table(result).splitlines()
    aucs = sorted((summary(d).auc for d in measured), reverse=True)
    assert [f"{auc:.3f}" for auc in aucs] == [line.split("|")[5].strip() for line in lines[2:]]
    assert "AUC-60" in lines[0]
    assert "ms" not in lines[0]
    line = protocol_line(result, M)
    assert line.startswith("6 pairs (kind=random, overlap=0.5, seed=0), at most 60 points, inliers=homography")


def test_pictures(results, folder):
    pairs, measured = results
    pictures = draw_benchmark_pictures(measured[:2], CONTENDERS, pairs, M, folder / "features")
    assert set(pictures) == {"sips", "corners"}
    assert [picture.label for picture in pictures["sips"]] == ["best", "median", "worst"]
    assert all(picture.image.ndim == 3 for of in pictures.values() for picture in of)

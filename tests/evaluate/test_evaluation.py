import dataclasses

import numpy as np
import pytest
import torch
from textured_scenes import ArraySequence, flight, texture

from sips_lit.baselines.orb import OrbDetector
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.baselines.sift import SiftDetector
from sips_lit.describe.sift import RootSift
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.evaluate.evaluation import FeatureCache, evaluate, versions
from sips_lit.evaluate.features import extract
from sips_lit.evaluate.pairs import PairSet, draw_pairs
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.klt import KltInliers
from sips_lit.match.mutual_nearest import distances, mutual_nearest


def sips() -> SipsDetector:
    torch.manual_seed(0)
    return SipsDetector(ScoreNetwork(3, 4), PointSelector())


@pytest.fixture(scope="module")
def pairs(tmp_path_factory) -> PairSet:
    sequences = [flight(8, size=(128, 96), name="a"), flight(6, size=(100, 90), seed=2, name="b")]
    return draw_pairs(sequences, HomographyInliers(), tmp_path_factory.mktemp("indexes"), 6, 0.5)


def cropped_inliers(pair, check, detector, descriptor):
    """Inliers of the n best points for n = 0 ... 60, matched and verified anew each time: the definition."""
    features = [extract(detector, descriptor, image, 60) for image in (pair.image0, pair.image1)]
    counts = []
    for n in range(61):
        best = [f.best(n) for f in features]
        matches = mutual_nearest(distances(*best))
        counts.append(int(check(pair, best[0].keypoints, best[1].keypoints, matches).inlier.sum()))
    return counts


@pytest.mark.parametrize(
    ("detector", "descriptor"),
    [(ShiTomasi(), RootSift()), (SiftDetector(), None), (OrbDetector(), None)],
    ids=["corners", "sift", "orb"],
)
def test_n_k_by_its_definition(pairs, detector, descriptor):
    result = evaluate(detector, descriptor, pairs, k=8, n_max=60)
    assert [row.pair for row in result.rows] == [pair.name for pair, _ in pairs]
    for row, (pair, check) in zip(result.rows, pairs, strict=True):
        counts = cropped_inliers(pair, check, detector, descriptor)
        enough = [n for n in range(61) if counts[n] >= 8]
        assert row.n_k == (enough[0] if enough else None)
        assert row.inliers == counts[60]
    solved = [row.n_k for row in result.rows if row.n_k is not None]
    assert result.succinctness.failures == len(result.rows) - len(solved)
    expected = np.mean([sum(n_k <= n for n_k in solved) / len(result.rows) for n in range(60)])
    assert result.succinctness.auc == pytest.approx(expected)


def test_halving_agrees_where_inliers_only_grow(pairs):
    for detector, descriptor in ((ShiTomasi(), RootSift()), (sips(), RootSift())):
        exact = evaluate(detector, descriptor, pairs, 8, 60)
        binary = evaluate(detector, descriptor, pairs, 8, 60, "binary")
        grows = 0
        for one, other, (pair, check) in zip(exact.rows, binary.rows, pairs, strict=True):
            counts = cropped_inliers(pair, check, detector, descriptor)
            if all(np.diff(np.array(counts) >= 8) >= 0):
                assert one.n_k == other.n_k
                grows += 1
            assert (other.matches, other.inliers) == (one.matches, one.inliers)
        assert grows > 0
        assert binary.protocol["search"] == "binary"


def test_the_protocol_is_complete(pairs):
    p = evaluate(sips(), RootSift(), pairs, 8, 60).protocol
    assert {name: p[name] for name in ("k", "n_max", "search", "seed", "pairs", "overlap")} == {
        "k": 8,
        "n_max": 60,
        "search": "exact",
        "seed": 0,
        "pairs": 6,
        "overlap": 0.5,
    }
    assert (p["detector"], p["descriptor"]) == ("SIPs", RootSift().name)
    assert p["sequences"] == ["a", "b"]
    assert p["verification"] == [dict(HomographyInliers().protocol)]
    assert p["verification"][0]["threshold"] == 3.0
    assert p["versions"] == versions()
    assert set(versions()) >= {"sips_lit", "torch", "opencv", "numpy"}
    assert evaluate(SiftDetector(), None, pairs, 8, 60).protocol["descriptor"] == "own"


def test_calibration_only_of_probabilities(pairs):
    result = evaluate(sips(), RootSift(), pairs, 8, 60)
    assert result.calibration is not None
    assert result.calibration.points == sum(row.points0 + row.points1 for row in result.rows)
    assert evaluate(ShiTomasi(), RootSift(), pairs, 8, 60).calibration is None


def test_the_same_result_twice(pairs):
    one, two = (evaluate(sips(), RootSift(), pairs, 8, 60) for _ in range(2))
    assert one.rows == two.rows
    np.testing.assert_array_equal(one.succinctness.curve, two.succinctness.curve)


def test_names(pairs):
    assert evaluate(ShiTomasi(), RootSift(), pairs, 8, 60).name == f"{ShiTomasi().name} + {RootSift().name}"
    assert evaluate(SiftDetector(), None, pairs, 8, 60).name == SiftDetector().name
    assert evaluate(SiftDetector(), None, pairs, 8, 60, name="mine").name == "mine"


def test_points_need_a_descriptor(pairs):
    with pytest.raises(BadInputError, match=r"does not describe them: choose descriptor="):
        evaluate(ShiTomasi(), None, pairs, 8, 60)


def test_images_without_any_point(tmp_path):
    grey = ArraySequence([np.full((60, 70), 90, np.uint8)] * 4, "grey", [np.eye(3)] * 4)
    pairs = draw_pairs([grey], HomographyInliers(), tmp_path, 3, 0.5)
    result = evaluate(ShiTomasi(), RootSift(), pairs, 8, 60)
    assert [(row.n_k, row.points0, row.inliers) for row in result.rows] == [(None, 0, 0)] * 3
    assert (result.succinctness.auc, result.succinctness.failures) == (0, 3)


class Counting(ShiTomasi):
    calls = 0

    def detect(self, image, n):
        type(self).calls += 1
        return super().detect(image, n)


def test_features_of_an_image_are_computed_once():
    cache = FeatureCache(Counting(), RootSift(), 20)
    image = texture(60, 80)
    first = cache(image)
    assert cache(image.copy()) is first
    assert Counting.calls == 1
    # the same bytes in another shape are another image
    assert cache(image.reshape(80, 60)) is not first
    assert Counting.calls == 2


def test_verification_of_each_source_by_its_own_check(tmp_path):
    data = [Source([flight(6, name="a")], inliers=HomographyInliers(1.5)), Source([flight(6, seed=1, name="b")])]
    pairs = draw_pairs(data, KltInliers(), tmp_path, 8, 0.5)
    checks = {pair.name.split(":")[0]: check for pair, check in pairs}
    assert isinstance(checks["a"], HomographyInliers)
    assert isinstance(checks["b"], KltInliers)
    assert [v["threshold"] for v in pairs.protocol["verification"]] == [1.5, 3.0]


def test_rows_are_plain(pairs):
    row = evaluate(ShiTomasi(), RootSift(), pairs, 8, 60).rows[0]
    assert all(value is None or type(value) in (int, str) for value in dataclasses.asdict(row).values())

import numpy as np
import pytest
from simulated_pairs import simulate
from textured_scenes import flight
from tiny_network import tiny_detector

from sips_lit.describe.sift import RootSift
from sips_lit.detect.recalibration import Recalibration
from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.method import Method
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.evaluate.recalibrate import (
    JudgedPair,
    calibration_at,
    coverage_of,
    groups_of,
    judge_pairs,
    split_pairs,
)
from sips_lit.frames.source import as_sources
from sips_lit.inliers.klt import KltInliers
from sips_lit.inliers.verification import verify
from sips_lit.pairs.choice import ListedPair

M = Measures(n_max=40, k=5, n=20, ks=(), calibration=(10, 30), pose=False)


def pair_set(sequences: int, pairs: int = 6) -> PairSet:
    one = flight(9, size=(128, 96))
    listed = [ListedPair(at % sequences, at, at + 2, 0.8) for at in range(pairs)]
    return PairSet(as_sources([one] * sequences), listed, KltInliers())


def test_every_second_sequence_is_held_back():
    split = split_pairs(pair_set(3))
    assert (split.fit, split.held) == ((0, 2, 3, 5), (1, 4))
    assert split.how == "1 of 3 sequences held back"


def test_of_one_sequence_the_later_half():
    split = split_pairs(pair_set(1, 5))
    assert (split.fit, split.held) == ((0, 1, 2), (3, 4))
    assert "only sequence" in split.how


def test_judged_pairs_are_those_that_are_verified_anew():
    pairs, detector = pair_set(1, 2), tiny_detector()
    method = Method("sips", "SIPs", detector, RootSift(), {})
    for at, judged in enumerate(judge_pairs(method, pairs, M, workers=1)):
        read = pairs.read(at, depth=False)
        found = [extracted(detector, image) for image in (read.image0, read.image1)]
        verified = verify(read, *found, KltInliers())
        assert len(judged.inliers) == 41
        assert judged.inliers[40] == verified.at(40).inlier_count
        assert set(judged.groups) == {10, 30}
        scores, inlier = verified.outcomes(10)
        both = judged.groups[10]
        np.testing.assert_allclose(np.concatenate([g.probability(Recalibration()) for g in both]), scores, atol=1e-6)
        np.testing.assert_array_equal(np.concatenate([g.inlier for g in both]), inlier)
        assert {g.n for g in both} == {10}


def extracted(detector, image):
    from sips_lit.evaluate.features import extract

    return extract(detector, RootSift(), image, 40).features


def simulated(truth: Recalibration, pairs: int) -> list[JudgedPair]:
    """Pairs whose images are draws of their own."""
    found = []
    for group in simulate(truth, pairs, (80,), 3):
        inliers = np.concatenate([[0], np.cumsum(group.inlier)])
        found.append(JudgedPair((group.logit, group.logit), {80: (group, group)}, inliers))
    return found


def test_the_true_recalibration_is_calibrated_and_keeps_its_promises():
    truth = Recalibration(0.7, -1.0, 0.0, 1.2)
    pairs = simulated(truth, 300)
    assert calibration_at(pairs, 80, truth).ece < 0.03 < 0.12 < calibration_at(pairs, 80).ece
    assert calibration_at(pairs, 80, truth).points == 2 * 80 * 300 == sum(len(g.inlier) for g in groups_of(pairs))
    for found in coverage_of(pairs, 8, truth, (0.5, 0.8)):
        assert found.promised + found.out_of_reach == 600
        assert found.observed == pytest.approx(found.asked, abs=0.08)
        assert 8 <= found.points <= 80

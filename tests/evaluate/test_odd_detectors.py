"""Detectors that misbehave, through the whole benchmark: nothing breaks, everything is counted."""

import math

import cv2
import numpy as np
import pytest
from table_rows import Row
from tiny_methods import method, run_methods
from wall_scene import Wall

from sips_lit.baselines.precomputed import PrecomputedDetector
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.describe.sift import RootSift
from sips_lit.errors import BadInputError
from sips_lit.evaluate.measures import Measures
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.evaluate.result import PairSetResult, PoseOutcome
from sips_lit.frames.source import Source
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.pairs.choice import ListedPair
from sips_lit.report.files import write_report
from sips_lit.report.summary import main_budget
from sips_lit.report.terminal import markdown
from sips_lit.types import Keypoints

M = Measures(k=8, ks=(5,), n_max=40, n=20, repeats=2, calibration=(), iterations=100)
NAN = float("nan")


class Odd(ShiTomasi):
    """Corners, after ``spoil`` had its way with arrays xy (N, 2) and score (N,)."""

    def __init__(self, spoil) -> None:
        super().__init__()
        self.spoil = spoil

    def detect(self, image, n):
        good = super().detect(image, n)
        xy, score = self.spoil(good.xy.copy(), good.score.copy())
        return Keypoints(xy.astype(np.float32), score.astype(np.float32), np.ones(len(xy), np.float32))


def with_three(bad_xy=None, bad_score=None):
    """Three more points, with the best scores or those given."""

    def spoil(xy, score):
        more = xy[:3] + 0.25 if bad_xy is None else np.array([bad_xy] * 3) + np.arange(3)[:, None]
        best = np.full(3, score.max() + 1 if bad_score is None else bad_score)
        return np.concatenate([more, xy]), np.concatenate([best, score])

    return spoil


def shuffled(xy, score):
    order = np.random.default_rng(0).permutation(len(xy))
    return xy[order], score[order]


def twice(xy, score):
    return np.repeat(xy, 2, 0), np.repeat(score, 2)


SPOILS = {
    "good": lambda xy, score: (xy, score),
    "few": lambda xy, score: (xy[:6], score[:6]),
    "three": lambda xy, score: (xy[:3], score[:3]),
    "none": lambda xy, score: (xy[:0], score[:0]),
    "twice": twice,
    "nan_score": with_three(bad_score=NAN),
    "infinite": with_three(bad_xy=[math.inf, 3]),
    "outside": with_three(bad_xy=[-9, 500]),
    "shuffled": shuffled,
}


def pairs_of(wall=None) -> PairSet:
    return PairSet([Source([wall or Wall(4)])], [ListedPair(0, 0, 2, 1), ListedPair(0, 1, 3, 1)], PoseDepthInliers())


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    odd = [method(Odd(spoil), RootSift(), key) for key, spoil in SPOILS.items()]
    return {r.key: r for r in run_methods(odd, pairs_of(), M, tmp_path_factory.mktemp("odd"))}


@pytest.mark.parametrize("key", ["twice", "nan_score", "infinite", "outside", "shuffled"])
def test_what_is_illegal_is_taken_out_and_the_rest_counts(results, key):
    good, odd = results["good"], results[key]
    np.testing.assert_array_equal(odd.n_k, good.n_k)
    np.testing.assert_array_equal(odd.budgets[20].inliers, good.budgets[20].inliers)
    np.testing.assert_array_equal(odd.budgets[20].translation_error, good.budgets[20].translation_error)
    assert np.isfinite(good.n_k).all()


def test_every_defect_is_counted(results):
    """Four images of forty points each."""

    def counted(key):
        return {kind: n for kind, n in results[key].defects.items() if n}

    clean = {"images": 4, "asked": 160, "returned": 160, "kept": 160}
    assert counted("good") == clean
    assert counted("shuffled") == {**clean, "unsorted": 4}
    assert counted("twice") == {**clean, "returned": 320, "duplicates": 160}
    assert counted("nan_score") == {**clean, "returned": 172, "invalid": 12}
    assert counted("infinite") == {**clean, "returned": 172, "invalid": 12}
    assert counted("outside") == {**clean, "returned": 172, "outside": 12}
    assert counted("few") == {**clean, "returned": 24, "kept": 24, "missing": 136, "short": 4}
    assert counted("none") == {"images": 4, "asked": 160, "missing": 160, "short": 4, "empty": 4}


def test_too_few_points(results):
    few, three, none = (results[key] for key in ("few", "three", "none"))
    assert few.points0.tolist() == [6, 6]
    assert (few.n_k[:, :, 0] <= 6).all() or np.isinf(few.n_k[:, :, 0]).any()
    assert np.isinf(few.n_k[:, :, 1]).all()  # eight inliers of six points
    assert (few.budgets[20].outcome == PoseOutcome.FEW_INLIERS).all()
    for result in (three, none):
        assert np.isinf(result.n_k).all()
        assert np.isinf(result.budgets[20].translation_error).all()
        assert (result.budgets[20].outcome == PoseOutcome.FEW_MATCHES).all()
        row = Row(result)
        assert (row["auc"], row["failures"], row["pose_auc_1m"], row["no_pose"]) == (0, 2, 0, 2)
    assert Row(results["good"])["no_pose"] == 0


def test_all_of_it_is_in_the_report(results, tmp_path):
    whole = PairSetResult("odd", "Odd", pairs_of().protocol, tuple(results.values()), {"gone": "no weights"})
    page = write_report(tmp_path, [whole], {}, "2026-01-02", {"cores": "2"})[0].read_text()
    assert "Defects in what the detectors returned" in page
    assert "Pairs without a pose at 20 points" in page
    assert "<td>Three</td><td>0</td><td>2</td><td>0</td>" in page  # a pose; fewer than 4 correspondences; few inliers
    assert "no pose at 20" in page
    assert "2026-01-02" in page
    for term in (
        "fewer points than asked for",
        "no points, or no matches",
        "pairs without depth",
        "RANSAC finds nothing",
    ):
        assert f"<dt>{term}</dt>" in page


def test_arrays_that_do_not_belong_together(tmp_path):
    def broken(xy, score):
        return xy, score[:-1]

    told = {}
    measured = run_methods(
        [method(Odd(broken), RootSift(), "broken"), method(ShiTomasi(), RootSift(), "good")],
        pairs_of(),
        M,
        tmp_path,
        on_skip=told.__setitem__,
    )
    assert [result.key for result in measured] == ["good"]
    assert "shapes (40, 2), (39,)" in told["broken"]


@pytest.fixture
def saved(tmp_path):
    """Corners of a wall's frames without scores or descriptors: 20 an image."""
    wall = Wall(4)
    for folder in ("images", "points"):
        (tmp_path / folder).mkdir()
    for index in range(4):
        cv2.imwrite(str(tmp_path / "images" / f"{index}.png"), wall.frame(index))
        np.savez(tmp_path / "points" / f"{index}.npz", kpts=ShiTomasi().detect(wall.frame(index), 20).xy[::-1])
    return PrecomputedDetector(tmp_path / "points", tmp_path / "images", "LF-Net")


def test_points_without_scores_are_judged_at_their_own_number_only(saved, tmp_path):
    m = Measures(k=8, ks=(5,), n_max=40, n=10, budgets=(20, 30), calibration=(), iterations=100)
    lfnet, corners = run_methods(
        [method(saved, RootSift(), "lfnet"), method(ShiTomasi(), RootSift(), "corners")], pairs_of(), m, tmp_path
    )
    assert set(np.unique(lfnet.n_k)) <= {20, math.inf}
    assert set(lfnet.budgets) == {20, 30}  # which ten are the best nobody knows
    np.testing.assert_array_equal(lfnet.budgets[20].inliers, corners.budgets[20].inliers)
    assert (lfnet.protocol["scores"], corners.protocol["scores"]) == ("none", "order")
    assert (main_budget(lfnet), "pose_auc_1m" in Row(lfnet).values) == (10, False)
    result = PairSetResult("set", "Set", pairs_of().protocol | {"pairs": 2}, (lfnet, corners), {})
    assert "| Lfnet (own n only) " in markdown(result)
    page = write_report(tmp_path / "report", [result], {}, machine={})[0].read_text()
    assert 'Lfnet <span class="tag">own n only</span>' in page
    assert "<dt>own n only</dt>" in page


def test_more_points_without_scores_than_can_be_asked_for(saved, tmp_path):
    told = {}
    few = Measures(k=5, ks=(), n_max=10, n=10, calibration=())
    run_methods([method(saved, RootSift(), "lfnet")], pairs_of(), few, tmp_path, on_skip=told.__setitem__)
    assert "20 points without scores, so the 10 best are not known" in told["lfnet"]


def test_pairs_that_nobody_can_judge_are_left_out_and_named():
    wall = Wall(4)
    whole = wall.depth(0)
    wall.depth = lambda index: {0: whole, 2: None}.get(index, np.full_like(whole, NAN))
    pairs = pairs_of(wall).verifiable()
    assert len(pairs) == 1
    assert pairs.table().name == ("wall:0-2",)
    assert pairs.left_out == ["wall:1-3"]
    assert (pairs.protocol["pairs"], pairs.protocol["left_out"]) == (1, ["wall:1-3"])
    assert "left_out" not in pairs_of().verifiable().protocol


@pytest.mark.parametrize(
    ("wall", "words"), [(Wall(4, poses=False), "has no pose, camera and depth"), (Wall(4, depth=False), "has no pose")]
)
def test_no_pair_can_be_judged(wall, words):
    with pytest.raises(BadInputError, match=f"no pair can be verified, as wall:0-2 {words}"):
        pairs_of(wall).verifiable()

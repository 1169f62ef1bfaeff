import numpy as np
import pytest
from klt_judging import judge, match
from textured_scenes import flight, keypoints, texture

from sips_lit.geometry.projection import apply_homography
from sips_lit.inliers.klt import KltInliers
from sips_lit.inliers.klt_retraced import RetracedKltInliers
from sips_lit.pairs.sampler import read_pair
from sips_lit.tracking.klt import KltTracker
from sips_lit.types import FramePair, Reason


@pytest.fixture(params=[KltInliers, RetracedKltInliers])
def check(request) -> KltInliers:
    """Both checks by KLT: they promise the same."""
    return request.param()


def test_each_reason(check, short_flight):
    pair = read_pair(short_flight, 0, 9)
    start = np.array([[80, 60], [70, 50], [90, 70], [2, 2]], float)
    goal = apply_homography(pair.homography, start)
    goal[1] += [2.0, 0.0]
    goal[2] += [0.0, 5.0]
    assert judge(check, pair, start, goal) == [Reason.INLIER, Reason.INLIER, Reason.FAR, Reason.LOST]


@pytest.mark.parametrize(("first", "last"), [(0, 9), (9, 0), (3, 4)])
def test_agrees_with_the_known_homography(check, short_flight, first, last):
    pair = read_pair(short_flight, first, last)
    generator = np.random.default_rng(0)
    start = generator.uniform([40, 40], [120, 80], (150, 2))
    off = generator.uniform(0, 8, 150)
    angle = generator.uniform(0, 2 * np.pi, 150)
    goal = apply_homography(pair.homography, start) + (off * [np.cos(angle), np.sin(angle)]).T
    reasons = np.array(judge(check, pair, start, goal))
    clear = np.abs(off - 3) > 0.8  # the threshold holds in both images, which differ in scale by a tenth
    tracked = reasons != Reason.LOST
    assert tracked.mean() > 0.85
    np.testing.assert_array_equal((reasons == Reason.INLIER)[clear & tracked], (off < 3)[clear & tracked])


@pytest.mark.parametrize(("zoom", "off", "expected"), [(1.05, 2.5, Reason.INLIER), (1.05, 4.0, Reason.FAR)])
def test_the_threshold_holds_forth_and_back(check, zoom, off, expected):
    scene = flight(9, step=(0, 0), zoom=zoom)  # the last image is 1.48 times as large
    start = np.array([[80.0, 60.0]])
    goal = np.add(apply_homography(scene.homography(0, 8), start), [off, 0])
    assert judge(check, read_pair(scene, 0, 8), start, goal) == [expected]
    # seen from the other side, the same match: 4 pixels there are 2.7 here, yet it stays far
    assert judge(check, read_pair(scene, 8, 0), goal, start) == [expected]


class OneWayTracker:
    """Points stay where they are, but back in time they are lost or go astray."""

    parameters = {}  # noqa: RUF012 - as short as it gets

    def __init__(self, back: float) -> None:
        self.back = back

    def track(self, frames, xy):
        ends = xy if frames[0][0, 0] == 0 else xy + np.float32(self.back)
        return ends, np.isfinite(ends).all(1)


@pytest.mark.parametrize(("back", "expected"), [(0, Reason.INLIER), (5, Reason.FAR), (np.nan, Reason.LOST)])
def test_the_way_back_must_agree_too(back, expected):
    frames = (np.zeros((40, 40), np.uint8), np.ones((40, 40), np.uint8))
    pair = FramePair("a:0-1", 0, 1, frames, *frames)
    check = KltInliers(OneWayTracker(back))
    assert judge(check, pair, [[20, 20], [9, 9]], [[21, 21], [30, 30]]) == [expected, Reason.FAR]


def test_what_is_hidden_in_between_is_lost(check):
    scene = flight(5, step=(1, 0), zoom=1.0)
    frames = list(scene.frames)
    frames[2] = frames[2].copy()
    frames[2][30:90, 50:110] = texture(60, 60, seed=5)
    whole, hidden = read_pair(scene, 0, 4), read_pair(type(scene)(frames), 0, 4)
    start = np.array([[80.0, 60.0], [25, 60]])
    goal = start - [4.0, 0]
    assert judge(check, whole, start, goal) == [Reason.INLIER, Reason.INLIER]
    assert judge(check, hidden, start, goal) == [Reason.LOST, Reason.INLIER]


def test_the_clean_frames_are_tracked_not_what_the_detector_sees(check, short_flight):
    pair = read_pair(short_flight, 0, 5)
    dark = FramePair(pair.name, 0, 5, pair.frames, np.zeros_like(pair.image0), np.zeros_like(pair.image1))
    start = np.array([[80.0, 60.0]])
    assert judge(check, dark, start, apply_homography(pair.homography, start)) == [Reason.INLIER]


def test_matches_of_any_points(check, short_flight):
    """Point i of image 0 is point (i + 1) % 4 of image 1: the way back must start there."""
    pair = read_pair(short_flight, 0, 6)
    start = np.array([[80, 60], [60, 50], [100, 70], [70, 80.0]])
    goal = np.roll(apply_homography(pair.homography, start), 1, axis=0)
    inliers = check(pair, keypoints(start), keypoints(goal), match([0, 1, 2, 3, 0], [1, 2, 3, 0, 2]))
    assert inliers.inlier.tolist() == [True] * 4 + [False]


def test_answers_are_per_match_in_any_order_and_number(check, short_flight):
    pair = read_pair(short_flight, 0, 6)
    start = np.array([[80, 60], [70, 50], [2, 2], [100, 70.0]])
    goal = np.add(apply_homography(pair.homography, start), [[0, 0], [0, 9], [0, 0], [1, 0]])
    together = judge(check, pair, start, goal)
    for i in range(4):
        assert judge(check, pair, start[i], goal[i]) == [together[i]]
    points0, points1 = keypoints(start), keypoints(goal)
    some = check(pair, points0, points1, match([3, 1, 0, 0], [3, 1, 1, 0]))
    assert [Reason(r) for r in some.reason] == [together[3], together[1], Reason.FAR, together[0]]
    assert some.known0.tolist() == some.known1.tolist() == [True] * 4


@pytest.mark.parametrize(("n0", "n1"), [(0, 0), (3, 0), (0, 2), (2, 3)])
def test_no_matches(check, short_flight, n0, n1):
    points0, points1 = keypoints(np.full((n0, 2), 50)), keypoints(np.full((n1, 2), 50))
    inliers = check(read_pair(short_flight, 0, 2), points0, points1, match([], []))
    assert (len(inliers.inlier), len(inliers.reason), len(inliers.known0), len(inliers.known1)) == (0, 0, n0, n1)


def test_protocol_tells_the_thresholds():
    check = KltInliers(threshold=2.0)
    assert check.protocol["inliers"] == "klt"
    assert check.protocol["threshold"] == 2.0
    assert check.protocol["max_roundtrip"] == 1.0
    assert KltInliers(KltTracker(max_roundtrip=0.5)).protocol["max_roundtrip"] == 0.5
    assert check.independent
    assert check.uses_frames


def test_residuals_lead_from_the_matched_point_to_the_end_of_the_track(check, short_flight):
    pair = read_pair(short_flight, 0, 9)
    start = np.array([[80, 60], [70, 50], [2, 2]], float)
    off = np.array([[1.5, 0.0], [0.0, -1.0], [0.0, 0.0]])
    goal = apply_homography(pair.homography, start) + off
    everything = match([0, 1, 2], [0, 1, 2])
    residual = check(pair, keypoints(start), keypoints(goal), everything).residual
    np.testing.assert_allclose(residual[:2, 0], -off[:2], atol=0.3)
    back = apply_homography(np.linalg.inv(pair.homography), goal) - start
    np.testing.assert_allclose(residual[:2, 1], back[:2], atol=0.3)
    assert np.isnan(residual[2]).all()  # lost

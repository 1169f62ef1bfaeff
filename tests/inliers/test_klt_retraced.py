import numpy as np
import pytest
from textured_scenes import flight, keypoints, texture

from sips_lit.geometry.projection import apply_homography
from sips_lit.inliers import klt_retraced
from sips_lit.inliers.klt_retraced import RetracedKltInliers
from sips_lit.pairs.sampler import read_pair
from sips_lit.tracking.both_ways import follow, retrace
from sips_lit.tracking.klt import KltTracker
from sips_lit.types import FramePair, Matches, Reason


def match(index0: list[int], index1: list[int]) -> Matches:
    return Matches(np.array(index0, np.int64), np.array(index1, np.int64))


def judge(pair: FramePair, xy0: object, xy1: object, check: RetracedKltInliers | None = None) -> list[Reason]:
    points0, points1 = keypoints(xy0), keypoints(xy1)
    everything = list(range(len(points0)))
    inliers = (check or RetracedKltInliers())(pair, points0, points1, match(everything, everything))
    np.testing.assert_array_equal(inliers.inlier, inliers.reason == Reason.INLIER)
    return [Reason(r) for r in inliers.reason]


def test_each_reason(short_flight):
    pair = read_pair(short_flight, 0, 9)
    start = np.array([[80, 60], [70, 50], [90, 70], [2, 2]], float)
    goal = apply_homography(pair.homography, start)
    goal[1] += [2.0, 0.0]
    goal[2] += [0.0, 5.0]
    assert judge(pair, start, goal) == [Reason.INLIER, Reason.INLIER, Reason.FAR, Reason.LOST]


@pytest.mark.parametrize(("first", "last"), [(0, 9), (9, 0), (3, 4)])
def test_agrees_with_the_known_homography(short_flight, first, last):
    pair = read_pair(short_flight, first, last)
    generator = np.random.default_rng(0)
    start = generator.uniform([40, 40], [120, 80], (150, 2))
    off = generator.uniform(0, 8, 150)
    angle = generator.uniform(0, 2 * np.pi, 150)
    goal = apply_homography(pair.homography, start) + (off * [np.cos(angle), np.sin(angle)]).T
    reasons = np.array(judge(pair, start, goal))
    clear = np.abs(off - 3) > 0.8  # the threshold holds in both images, which differ in scale by a tenth
    tracked = reasons != Reason.LOST
    assert tracked.mean() > 0.85
    np.testing.assert_array_equal((reasons == Reason.INLIER)[clear & tracked], (off < 3)[clear & tracked])


@pytest.mark.parametrize(("zoom", "off", "expected"), [(1.05, 2.5, Reason.INLIER), (1.05, 4.0, Reason.FAR)])
def test_the_threshold_holds_forth_and_back(zoom, off, expected):
    scene = flight(9, step=(0, 0), zoom=zoom)  # the last image is 1.48 times as large
    start = np.array([[80.0, 60.0]])
    goal = np.add(apply_homography(scene.homography(0, 8), start), [off, 0])
    assert judge(read_pair(scene, 0, 8), start, goal) == [expected]
    # seen from the other side, the same match: 4 pixels there are 2.7 here, yet it stays far
    assert judge(read_pair(scene, 8, 0), goal, start) == [expected]


@pytest.mark.parametrize(("back", "expected"), [(0, Reason.INLIER), (5, Reason.FAR), (np.nan, Reason.LOST)])
def test_the_way_back_must_agree_too(monkeypatch, back, expected):
    """Points stay where they are, but back in time they are lost or go astray."""

    def astray(tracker, frames, xy, moves):
        ends = xy + np.float32(back)
        return ends, np.isfinite(ends).all(1)

    monkeypatch.setattr(klt_retraced, "retrace", astray)
    still = (texture(60, 80),) * 2
    pair = FramePair("a:0-1", 0, 1, still, *still)
    assert judge(pair, [[20, 20], [9, 9]], [[21, 21], [30, 30]]) == [expected, Reason.FAR]


def test_what_is_hidden_in_between_is_lost():
    scene = flight(5, step=(1, 0), zoom=1.0)
    frames = list(scene.frames)
    frames[2] = frames[2].copy()
    frames[2][30:90, 50:110] = texture(60, 60, seed=5)
    whole, hidden = read_pair(scene, 0, 4), read_pair(type(scene)(frames), 0, 4)
    start = np.array([[80.0, 60.0], [25, 60]])
    goal = start - [4.0, 0]
    assert judge(whole, start, goal) == [Reason.INLIER, Reason.INLIER]
    assert judge(hidden, start, goal) == [Reason.LOST, Reason.INLIER]


def test_the_clean_frames_are_tracked_not_what_the_detector_sees(short_flight):
    pair = read_pair(short_flight, 0, 5)
    dark = FramePair(pair.name, 0, 5, pair.frames, np.zeros_like(pair.image0), np.zeros_like(pair.image1))
    start = np.array([[80.0, 60.0]])
    assert judge(dark, start, apply_homography(pair.homography, start)) == [Reason.INLIER]


def test_matches_of_any_points(short_flight):
    """Point i of image 0 is point (i + 1) % 4 of image 1: the way back must start there."""
    pair = read_pair(short_flight, 0, 6)
    start = np.array([[80, 60], [60, 50], [100, 70], [70, 80.0]])
    goal = np.roll(apply_homography(pair.homography, start), 1, axis=0)
    inliers = RetracedKltInliers()(pair, keypoints(start), keypoints(goal), match([0, 1, 2, 3, 0], [1, 2, 3, 0, 2]))
    assert inliers.inlier.tolist() == [True] * 4 + [False]


def test_answers_are_per_match_in_any_order_and_number(short_flight):
    pair = read_pair(short_flight, 0, 6)
    start = np.array([[80, 60], [70, 50], [2, 2], [100, 70.0]])
    goal = np.add(apply_homography(pair.homography, start), [[0, 0], [0, 9], [0, 0], [1, 0]])
    together = judge(pair, start, goal)
    for i in range(4):
        assert judge(pair, start[i], goal[i]) == [together[i]]
    points0, points1 = keypoints(start), keypoints(goal)
    some = RetracedKltInliers()(pair, points0, points1, match([3, 1, 0, 0], [3, 1, 1, 0]))
    assert [Reason(r) for r in some.reason] == [together[3], together[1], Reason.FAR, together[0]]
    assert some.known0.tolist() == some.known1.tolist() == [True] * 4


@pytest.mark.parametrize(("n0", "n1"), [(0, 0), (3, 0), (0, 2), (2, 3)])
def test_no_matches(short_flight, n0, n1):
    points0, points1 = keypoints(np.full((n0, 2), 50)), keypoints(np.full((n1, 2), 50))
    inliers = RetracedKltInliers()(read_pair(short_flight, 0, 2), points0, points1, match([], []))
    assert (len(inliers.inlier), len(inliers.reason), len(inliers.known0), len(inliers.known1)) == (0, 0, n0, n1)


def test_protocol_tells_the_thresholds():
    check = RetracedKltInliers(threshold=2.0)
    assert check.protocol["inliers"] == "klt_retraced"
    assert check.protocol["threshold"] == 2.0
    assert check.protocol["retraced_below"] == 8.0
    assert check.protocol["max_roundtrip"] == 1.0
    assert RetracedKltInliers(KltTracker(max_roundtrip=0.5)).protocol["max_roundtrip"] == 0.5
    assert check.independent
    assert check.uses_frames


def test_residuals_lead_from_the_matched_point_to_the_end_of_the_track(short_flight):
    pair = read_pair(short_flight, 0, 9)
    start = np.array([[80, 60], [70, 50], [2, 2]], float)
    off = np.array([[1.5, 0.0], [0.0, -1.0], [0.0, 0.0]])
    goal = apply_homography(pair.homography, start) + off
    everything = match([0, 1, 2], [0, 1, 2])
    residual = RetracedKltInliers()(pair, keypoints(start), keypoints(goal), everything).residual
    np.testing.assert_allclose(residual[:2, 0], -off[:2], atol=0.3)
    back = apply_homography(np.linalg.inv(pair.homography), goal) - start
    np.testing.assert_allclose(residual[:2, 1], back[:2], atol=0.3)
    assert np.isnan(residual[2]).all()  # lost


def tracked_twice(pair: FramePair, xy0: np.ndarray, xy1: np.ndarray) -> list[bool]:
    """The definition, match by match: the track of either point ends within 3 px of the other."""
    found = []
    for start, goal in zip(xy0, xy1, strict=True):
        there, _ = KltTracker().track(pair.frames, start[None])
        back, _ = KltTracker().track(pair.frames[::-1], goal[None])
        found.append(bool(np.hypot(*(there[0] - goal)) <= 3 and np.hypot(*(back[0] - start)) <= 3))
    return found


@pytest.mark.parametrize(
    ("step", "zoom"), [((2.3, -1.1), 1.01), ((0.2, 0.1), 1.0), ((8.5, -2.0), 1.0), ((1.0, 0.5), 1.04)]
)
def test_judges_as_tracking_each_match_twice_does(step, zoom):
    """Slow, fast (over what is retraced) and growing scenes with something that passes before them."""
    scene = flight(8, step=step, zoom=zoom)
    frames = [frame.copy() for frame in scene.frames]
    for at, frame in enumerate(frames):
        frame[40:70, 10 + 8 * at : 40 + 8 * at] = texture(30, 30, seed=5)
    pair = read_pair(type(scene)(frames), 0, 7)
    generator = np.random.default_rng(1)
    start = generator.uniform(5, [155, 115], (400, 2)).astype(np.float32)
    goal = apply_homography(scene.homography(0, 7), start) + generator.normal(0, 1.6, (400, 2))
    goal = goal.astype(np.float32)
    inlier = np.array(judge(pair, start, goal)) == Reason.INLIER
    expected = np.array(tracked_twice(pair, start, goal))
    assert 0.1 < expected.mean() < 0.9
    assert (inlier == expected).mean() >= 0.995


def test_the_way_back_gets_the_moves_of_its_own_match_in_their_order(monkeypatch, short_flight):
    given = []

    def noted(tracker, frames, xy, moves):
        given.append(moves)
        return retrace(tracker, frames, xy, moves)

    monkeypatch.setattr(klt_retraced, "retrace", noted)
    pair = read_pair(short_flight, 0, 6)
    start = np.array([[100, 70], [2, 2], [60, 50], [80, 60.0]])
    goal = apply_homography(pair.homography, start)
    RetracedKltInliers()(pair, keypoints(start), keypoints(goal), match([3, 0, 1, 2], [3, 0, 1, 2]))
    forth = follow(KltTracker(), pair.frames, start.astype(np.float32)).moves
    np.testing.assert_array_equal(given[0], forth[::-1][:, [3, 0, 2]])


def test_the_tracker_that_is_given_tracks_forth(short_flight):
    """The point crosses the margin in the last step: on the way back it only begins there."""
    pair = read_pair(short_flight, 0, 4)
    start = np.array([[40.0, 60.0]])
    before, goal = (apply_homography(short_flight.homography(0, at), start) for at in (3, 4))
    assert goal[0, 0] < before[0, 0] - 1
    margin = float(before[0, 0] + goal[0, 0]) / 2
    assert judge(pair, start, goal) == [Reason.INLIER]
    assert judge(pair, start, goal, RetracedKltInliers(KltTracker(margin=margin))) == [Reason.LOST]

import numpy as np
import pytest
from klt_judging import judge, match
from textured_scenes import flight, keypoints, texture

from sips_lit.geometry.projection import apply_homography
from sips_lit.inliers import klt_retraced
from sips_lit.inliers.klt_retraced import RetracedKltInliers
from sips_lit.pairs.sampler import read_pair
from sips_lit.tracking.both_ways import follow, retrace
from sips_lit.tracking.klt import KltTracker
from sips_lit.types import FramePair, Reason


@pytest.mark.parametrize(("back", "expected"), [(0, Reason.INLIER), (5, Reason.FAR), (np.nan, Reason.LOST)])
def test_the_way_back_must_agree_too(monkeypatch, back, expected):
    """Points stay where they are, but back in time they are lost or go astray."""

    def astray(tracker, frames, xy, moves):
        ends = xy + np.float32(back)
        return ends, np.isfinite(ends).all(1)

    monkeypatch.setattr(klt_retraced, "retrace", astray)
    still = (texture(60, 80),) * 2
    pair = FramePair("a:0-1", 0, 1, still, *still)
    assert judge(RetracedKltInliers(), pair, [[20, 20], [9, 9]], [[21, 21], [30, 30]]) == [expected, Reason.FAR]


def test_protocol_tells_the_thresholds():
    check = RetracedKltInliers(threshold=2.0)
    assert check.protocol["inliers"] == "klt_retraced"
    assert check.protocol["threshold"] == 2.0
    told = [check.protocol[name] for name in ("retraced_below", "steady_within", "found_within", "most")]
    assert told == [8.0, 1.5, 4.0, 0.7]
    assert check.protocol["max_roundtrip"] == 1.0
    assert RetracedKltInliers(KltTracker(max_roundtrip=0.5)).protocol["max_roundtrip"] == 0.5
    assert check.independent
    assert check.uses_frames


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
    inlier = np.array(judge(RetracedKltInliers(), pair, start, goal)) == Reason.INLIER
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
    assert judge(RetracedKltInliers(), pair, start, goal) == [Reason.INLIER]
    assert judge(RetracedKltInliers(KltTracker(margin=margin)), pair, start, goal) == [Reason.LOST]

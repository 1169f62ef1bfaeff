import cv2
import numpy as np
import pytest
from textured_scenes import flight, texture

from sips_lit.geometry.projection import apply_homography
from sips_lit.tracking import both_ways
from sips_lit.tracking.both_ways import follow, retrace
from sips_lit.tracking.klt import KltTracker


def spread(count: int = 200, border: int = 8) -> np.ndarray:
    generator = np.random.default_rng(0)
    return generator.uniform(border, [159 - border, 119 - border], (count, 2)).astype(np.float32)


@pytest.mark.parametrize(("step", "zoom"), [((2.3, -1.1), 1.0), ((2.3, -1.1), 1.02), ((10.0, 3.0), 1.0)])
def test_follows_as_the_tracker_does(step, zoom):
    scene = flight(6, step=step, zoom=zoom)
    xy = spread()
    tracks = follow(KltTracker(), scene.frames, xy)
    ends, survived = KltTracker().track(scene.frames, xy)
    assert 0.2 < survived.mean() < 0.99
    assert (tracks.survived == survived).mean() >= 0.98
    both = tracks.survived & survived
    np.testing.assert_allclose(tracks.ends[both], ends[both], atol=0.1)
    np.testing.assert_array_equal(np.isnan(tracks.ends).any(1), ~tracks.survived)


def test_what_moves_steadily_is_searched_where_it_would_be(monkeypatch):
    """In two steps through the pyramid, to know how it moves; then in the full image alone, until it turns."""
    levels, results = [], []
    flow = cv2.calcOpticalFlowPyrLK

    def noted(image0, image1, xy, guess, **options):
        levels[-1].append((options["maxLevel"], len(xy)))
        return flow(image0, image1, xy, guess, **options)

    frames = flight(6, step=(2.0, 1.0), zoom=1.03).frames
    paths, xy = (frames, [*frames[:4], *frames[:2]]), spread()  # the second one jumps back by three steps
    monkeypatch.setattr(cv2, "calcOpticalFlowPyrLK", noted)
    for path in paths:
        levels.append([])
        tracks = follow(KltTracker(), path, xy)
        assert 0.5 < tracks.survived.mean() < 0.95
        results.append(tracks)
    steady, turning = levels
    assert [level for level, _ in steady[:4]] == [3, 0, 3, 0]
    assert sum(count for level, count in steady[4:] if level) < 0.1 * sum(count for level, count in steady[4:])
    assert sum(count for level, count in turning[6:] if level) > len(xy)
    monkeypatch.undo()
    for path, tracks in zip(paths, results, strict=True):
        ends, survived = KltTracker().track(path, xy)
        both = tracks.survived & survived
        np.testing.assert_allclose(tracks.ends[both], ends[both], atol=0.1)


def test_each_point_is_searched_where_it_would_be_itself(monkeypatch):
    """Two halves pass each other, and the first points soon leave the image: others have other numbers then."""
    left, right = texture(120, 120, seed=1), texture(120, 120, seed=2)
    frames = [np.hstack([left[:, 4 * at : 4 * at + 80], right[:, 32 - 4 * at : 112 - 4 * at]]) for at in range(7)]
    y = np.linspace(10, 109, 30)
    columns = [np.stack([np.full(30, x), y], 1) for x in (9, 40, 110, 55, 125)]
    xy = np.stack(columns, 1).reshape(-1, 2).astype(np.float32)
    searched, flow = [], cv2.calcOpticalFlowPyrLK

    def noted(image0, image1, xy, guess, **options):
        searched.append((options["maxLevel"], len(xy)))
        return flow(image0, image1, xy, guess, **options)

    monkeypatch.setattr(cv2, "calcOpticalFlowPyrLK", noted)
    tracks = follow(KltTracker(), frames, xy)
    assert not tracks.survived[::5].any()
    assert tracks.survived.mean() > 0.5
    assert sum(count for level, count in searched[4:] if level) < 0.1 * sum(count for level, count in searched[4:])


def test_what_something_passes_before_in_steady_motion_is_lost():
    frames = [frame.copy() for frame in flight(8, step=(2.0, 1.0), zoom=1.0).frames]
    for at, frame in enumerate(frames[4:]):
        frame[30:90, 40 + 4 * at : 80 + 4 * at] = texture(60, 40, seed=9)
    tracks = follow(KltTracker(), frames, spread(400))
    _, survived = KltTracker().track(frames, spread(400))
    held = [np.isfinite(move).all(1).mean() for move in tracks.moves]
    assert held[2] - held[3] > 0.05, "the first step with what passes"
    assert (tracks.survived == survived).mean() > 0.98


def test_moves_lead_from_start_to_end(short_flight):
    xy = spread()
    tracks = follow(KltTracker(), short_flight.frames, xy)
    assert tracks.moves.shape == (11, len(xy), 2)
    whole = tracks.survived
    np.testing.assert_allclose(xy[whole] + tracks.moves[:, whole].sum(0), tracks.ends[whole], atol=1e-3)
    np.testing.assert_array_equal(np.isnan(tracks.moves[-1]).any(1), ~whole)
    first = KltTracker().step(*short_flight.frames[:2], xy)[0] - xy
    held = np.isfinite(tracks.moves[0]).all(1)
    np.testing.assert_allclose(tracks.moves[0][held], first[held], atol=1e-4)


@pytest.mark.parametrize("small", [0.0, both_ways.SMALL_MOTION, 1e3])
@pytest.mark.parametrize("step", [(2.3, -1.1), (9.0, -4.0)])
def test_retraces_to_where_geometry_says(monkeypatch, step, small):
    """Points up to 2 px off the ends of the tracks; retraced by guesses, by searches, or as the motion is."""
    monkeypatch.setattr(both_ways, "SMALL_MOTION", small)
    scene = flight(7, step=step, zoom=1.02)
    tracks = follow(KltTracker(), scene.frames, spread())
    whole = np.flatnonzero(tracks.survived)
    off = np.random.default_rng(1).uniform(-1.4, 1.4, (len(whole), 2))
    xy = (tracks.ends[whole] + off).astype(np.float32)
    back, survived = retrace(KltTracker(), scene.frames[::-1], xy, tracks.moves[::-1, whole])
    assert survived.mean() > 0.9
    truth = apply_homography(scene.homography(6, 0), xy)
    error = np.linalg.norm(back - truth, axis=1)[survived]
    assert np.median(error) < 0.25
    assert error.max() < 1.0
    assert np.isnan(back[~survived]).all()


@pytest.mark.parametrize(("step", "searched"), [((1.0, 0.5), False), ((9.0, 0.0), True)])
def test_only_fast_steps_back_are_searched_through_the_pyramid(monkeypatch, step, searched):
    levels = []
    flow = cv2.calcOpticalFlowPyrLK

    def noted(image0, image1, xy, guess, **options):
        levels.append(options["maxLevel"])
        return flow(image0, image1, xy, guess, **options)

    scene = flight(4, step=step, zoom=1.0)
    tracks = follow(KltTracker(), scene.frames, spread(border=40))
    whole = np.flatnonzero(tracks.survived)
    assert len(whole) > 50
    monkeypatch.setattr(cv2, "calcOpticalFlowPyrLK", noted)
    retrace(KltTracker(), scene.frames[::-1], tracks.ends[whole], tracks.moves[::-1, whole])
    assert levels == ([3, 0] if searched else [0]) * 3  # forth through the pyramid, its way back not


def test_what_does_not_retrace_is_searched_and_lost_where_it_is_hidden():
    scene = flight(3, step=(1.0, 0.0), zoom=1.0)
    tracks = follow(KltTracker(), scene.frames, np.array([[80, 60], [30, 60], [120, 90]], np.float32))
    hidden = scene.frames[1].copy()
    hidden[40:80, 60:110] = texture(40, 50, seed=9)
    frames = scene.frames[2], hidden, scene.frames[0]
    assert retrace(KltTracker(), frames, tracks.ends, tracks.moves[::-1])[1].tolist() == [False, True, True]
    wrong = tracks.moves[::-1] + np.float32(2.5)  # tracks that lead elsewhere: the search still finds the way
    ends, survived = retrace(KltTracker(), scene.frames[::-1], tracks.ends, wrong)
    assert survived.all()
    np.testing.assert_allclose(ends, [[80, 60], [30, 60], [120, 90]], atol=0.2)


def test_a_step_hidden_in_between_ends_a_track_that_is_followed():
    image = texture(120, 160)
    covered = image.copy()
    covered[40:80, 60:110] = texture(40, 50, seed=9)
    xy = np.array([[85, 60], [30, 60], [130, 100]], np.float32)
    assert follow(KltTracker(), [image, covered, image], xy).survived.tolist() == [False, True, True]


@pytest.mark.parametrize("margin", [4.0, 20.0])
def test_the_margin_is_kept_both_ways(margin):
    image = texture(100, 120)
    x, y = np.meshgrid(np.arange(0, 120, 3), np.arange(0, 100, 3))
    xy = np.stack([x.ravel(), y.ravel()], 1).astype(np.float32) + np.float32(0.4)
    inside = ((xy >= margin) & (xy <= np.array([119, 99]) - margin)).all(1)
    tracker, still = KltTracker(margin=margin), np.zeros((1, len(xy), 2), np.float32)
    np.testing.assert_array_equal(follow(tracker, [image, image], xy).survived, inside)
    np.testing.assert_array_equal(retrace(tracker, [image, image], xy, still)[1], inside)


@pytest.mark.parametrize("most", [0.1, 0.5, 3.0])
def test_a_step_returns_within_the_round_trip(most):
    image0, image1 = flight(2, step=(9, -5), zoom=1.2).frames
    xy, stop = spread(1000, border=4), (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 15, 0.03)
    there, found, _ = cv2.calcOpticalFlowPyrLK(image0, image1, xy, None, winSize=(15, 15), maxLevel=3, criteria=stop)
    options = {"winSize": (15, 15), "maxLevel": 0, "criteria": stop, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(image1, image0, there, xy.copy(), **options)
    inside = [4 <= x <= 155 and 4 <= y <= 115 for x, y in there]
    expected = (np.hypot(*(back - xy).T) <= most) & inside & (found & found_back).ravel().astype(bool)
    survived = follow(KltTracker(max_roundtrip=most), [image0, image1], xy).survived
    np.testing.assert_array_equal(survived, expected)
    assert 0 < survived.sum() < len(xy)


@pytest.mark.parametrize("frames", [1, 3])
def test_no_points_and_one_frame(short_flight, frames):
    none = np.zeros((0, 2), np.float32)
    tracks = follow(KltTracker(), short_flight.frames[:frames], none)
    assert (tracks.ends.shape, tracks.survived.shape, tracks.moves.shape) == ((0, 2), (0,), (frames - 1, 0, 2))
    assert retrace(KltTracker(), short_flight.frames[:frames], none, tracks.moves)[0].shape == (0, 2)
    xy = np.array([[5, 6], [500, 500]], np.float32)
    if frames == 1:
        np.testing.assert_array_equal(follow(KltTracker(), short_flight.frames[:1], xy).ends, xy)

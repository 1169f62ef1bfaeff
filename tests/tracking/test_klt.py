import cv2
import numpy as np
import pytest
from textured_scenes import flight, texture

from sips_lit.errors import BadInputError
from sips_lit.geometry.projection import apply_homography
from sips_lit.tracking.klt import KltTracker


def grid(width: int = 160, height: int = 120, border: int = 30, step: int = 10) -> np.ndarray:
    x, y = np.meshgrid(np.arange(border, width - border, step), np.arange(border, height - border, step))
    return np.stack([x.ravel(), y.ravel()], 1).astype(np.float32)


@pytest.mark.parametrize("zoom", [1.0, 1.01])
def test_follows_a_known_motion_through_many_frames(zoom):
    scene = flight(10, zoom=zoom)
    xy = grid()
    ends, survived = KltTracker().track(scene.frames, xy)
    truth = apply_homography(scene.homography(0, 9), xy)
    assert survived.mean() > 0.8
    error = np.linalg.norm(ends - truth, axis=1)[survived]
    assert np.median(error) < 0.2
    assert error.max() < 0.6
    assert np.linalg.norm(ends - xy, axis=1)[survived].min() > 5  # the motion is large against the tolerance


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"window": 2}, "window of the tracker is 2: give 3 or more"),
        ({"window": -1}, "window of the tracker is -1"),
        ({"max_level": -1}, "max_level of the tracker is -1: give 0 or more"),
    ],
)
def test_patches_and_pyramids_that_there_are_not(option, words):
    with pytest.raises(BadInputError, match=words):
        KltTracker(**option)
    assert KltTracker(window=3, max_level=0).step(texture(40, 40), texture(40, 40), grid(60, 60, 20, 5))[1].any()


def test_a_step_is_that_of_the_homography(short_flight):
    xy = grid(border=20)
    places, held = KltTracker().step(short_flight.frames[0], short_flight.frames[1], xy)
    assert held.all()
    np.testing.assert_allclose(places, apply_homography(short_flight.homography(0, 1), xy), atol=0.3)


def test_lost_points_are_nan_and_others_keep_their_place_in_the_list(short_flight):
    xy = np.array([[2, 60], [80, 60], [158, 118], [100, 40]], np.float32)  # the first and third leave at once
    ends, survived = KltTracker().track(short_flight.frames, xy)
    assert survived.tolist() == [False, True, False, True]
    assert np.isnan(ends[~survived]).all()
    np.testing.assert_allclose(ends[survived], apply_homography(short_flight.homography(0, 11), xy[survived]), atol=0.6)


def test_what_is_covered_is_lost():
    image = texture(120, 160)
    covered = image.copy()
    covered[40:80, 60:110] = texture(40, 50, seed=9)
    xy = np.array([[85, 60], [30, 60], [130, 100]], np.float32)
    _, held = KltTracker().step(image, covered, xy)
    assert held.tolist() == [False, True, True]


def test_going_back_must_return():
    # a jump far beyond the reach of the window: tracks end anywhere
    image, moved = texture(120, 160), np.roll(texture(120, 160), 60, axis=1)
    xy = grid()
    forth, held = KltTracker(max_roundtrip=0.5).step(image, moved, xy)
    back, _ = KltTracker(max_roundtrip=1e6, margin=-1e6).step(moved, image, forth)
    distance = np.linalg.norm(back - xy, axis=1)
    assert (distance[held] <= 0.5 + 1e-3).all()
    assert held.mean() < 0.2
    looser = KltTracker(max_roundtrip=20.0).step(image, moved, xy)[1]
    assert held.sum() < looser.sum()


@pytest.mark.parametrize(
    "parameters",
    [
        {},
        {"max_roundtrip": 0.3},
        {"max_roundtrip": 3.0},
        {"window": 7},
        {"max_level": 1},
        {"max_level": 0},
        {"iterations": 2},
        {"accuracy": 0.5},
        {"margin": 20.0},
    ],
)
def test_a_step_by_definition(parameters):
    """Forth and back with OpenCV's own call, and each condition written out, on images that track badly."""
    names = {"window": 15, "max_level": 3, "iterations": 15, "accuracy": 0.03, "max_roundtrip": 1.0, "margin": 4.0}
    p = {**names, **parameters}
    image0, image1 = flight(2, step=(9, -5), zoom=1.2).frames
    xy = grid(border=4, step=5)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, p["iterations"], p["accuracy"])
    options = {"winSize": (p["window"], p["window"]), "maxLevel": p["max_level"], "criteria": criteria}
    forth, there, _ = cv2.calcOpticalFlowPyrLK(image0, image1, xy, None, **options)
    back, here, _ = cv2.calcOpticalFlowPyrLK(image1, image0, forth, None, **options)
    expected = []
    for start, (x, y), end, *found in zip(xy, forth, back, there, here, strict=True):
        returns = np.hypot(*(end - start)) <= p["max_roundtrip"]
        inside = p["margin"] <= x <= 159 - p["margin"] and p["margin"] <= y <= 119 - p["margin"]
        expected.append(returns and inside and all(found))
    places, held = KltTracker(**parameters).step(image0, image1, xy)
    np.testing.assert_array_equal(places, forth)
    np.testing.assert_array_equal(held, expected)
    assert 0 < held.sum() < len(xy)


def test_parameters_change_a_step():
    """Else the test above would say nothing about them."""
    image0, image1 = flight(2, step=(9, -5), zoom=1.2).frames
    default = KltTracker().step(image0, image1, grid())[0]
    for name, value in {"window": 21, "max_level": 1, "iterations": 2, "accuracy": 0.5}.items():
        assert not np.array_equal(KltTracker(**{name: value}).step(image0, image1, grid())[0], default), name


def test_flat_images_hold_no_track():
    flat = np.full((60, 80), 128, np.uint8)
    _, held = KltTracker().step(flat, texture(60, 80), grid(80, 60, 10))
    assert not held.any()
    _, held = KltTracker().step(flat, flat, grid(80, 60, 10))  # a point that stays where it was is not found, either
    assert not held.any()


@pytest.mark.parametrize("way", [1, -1])
def test_what_is_not_found_on_one_of_both_ways_is_lost(way):
    """In a flat image a round blob is held in its place by its symmetry; OpenCV does not move what it does not find."""
    x, y = np.meshgrid(np.arange(80), np.arange(64))
    blob = (20 + 200 * np.exp(-((x - 40) ** 2 + (y - 32) ** 2) / 18)).astype(np.uint8)
    image0, image1 = [blob, np.full((64, 80), 20, np.uint8)][::way]
    xy, options = np.array([[40, 32]], np.float32), {"winSize": (15, 15), "maxLevel": 3}
    forth, found, _ = cv2.calcOpticalFlowPyrLK(image0, image1, xy, None, **options)
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(image1, image0, forth, None, **options)
    assert [found.item(), found_back.item()] == [1, 0][::way]
    np.testing.assert_allclose(back, xy, atol=1e-3)
    assert not KltTracker().step(image0, image1, xy)[1].any()


@pytest.mark.parametrize("margin", [0.0, 4.0, 15.0])
def test_the_margin_is_kept(margin):
    image = texture(100, 120)
    x, y = np.meshgrid(np.arange(120), np.arange(100))
    xy = np.stack([x.ravel(), y.ravel()], 1)[::3].astype(np.float32)
    places, held = KltTracker(margin=margin).step(image, image, xy)
    inside = ((xy >= margin) & (xy <= np.array([119, 99]) - margin)).all(1)
    near_edge = (np.abs(xy - margin) < 0.1).any(1) | (np.abs(xy - (np.array([119, 99]) - margin)) < 0.1).any(1)
    np.testing.assert_array_equal(held[~near_edge], inside[~near_edge])
    np.testing.assert_allclose(places[held], xy[held], atol=0.05)


def test_no_points(short_flight):
    none = np.zeros((0, 2), np.float32)
    places, held = KltTracker().step(short_flight.frames[0], short_flight.frames[1], none)
    assert places.shape == (0, 2)
    assert held.shape == (0,)
    ends, survived = KltTracker().track(short_flight.frames, none)
    assert ends.shape == (0, 2)
    assert survived.shape == (0,)


def test_one_frame_is_no_step():
    xy = np.array([[5, 6], [500, 500]], np.float32)
    ends, survived = KltTracker().track([texture(50, 50)], xy)
    np.testing.assert_array_equal(ends, xy)
    assert survived.all()


def test_accepts_points_of_any_memory_layout(short_flight):
    xy = grid()
    expected = KltTracker().track(short_flight.frames[:3], xy)
    other = KltTracker().track(short_flight.frames[:3], np.asfortranarray(xy))
    np.testing.assert_array_equal(expected[0], other[0])


def test_parameters_name_everything_a_track_depends_on():
    names = {"window": 15, "max_level": 3, "iterations": 15, "accuracy": 0.03, "max_roundtrip": 1.0, "margin": 4.0}
    assert dict(KltTracker().parameters) == {**names, "opencv": cv2.__version__}
    assert KltTracker(window=15).parameters["window"] == 15

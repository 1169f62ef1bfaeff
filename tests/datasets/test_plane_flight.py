import multiprocessing
import pickle

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from textured_scenes import texture

import sips_lit.datasets.plane_flight as plane_flight_module
from sips_lit.datasets.plane_flight import Path6D, VirtualFlight, random_path
from sips_lit.datasets.virtual_flight import flights_over
from sips_lit.geometry.projection import apply_homography
from sips_lit.pairs.overlap import OverlapParameters, measure_overlap

STILL = cv2.GaussianBlur(texture(400, 600), (0, 0), 3)  # smooth, so that sampling it twice loses little
SIZE = (160, 120)


def flights(
    count: int = 6, length: int = 40, seed: int = 0, still: np.ndarray = STILL, size: tuple[int, int] = SIZE
) -> list[VirtualFlight]:
    made = flights_over([("still", still)], size, length, count, seed)
    assert all(isinstance(flight, VirtualFlight) for flight in made)
    return made  # type: ignore[return-value]  # asserted above


def corners(size: tuple[int, int]) -> np.ndarray:
    return np.array([[x, y] for y in (0, size[1] - 1) for x in (0, size[0] - 1)], np.float64)


def corner_motion(flight: VirtualFlight) -> np.ndarray:
    """How far the corner that moves most gets in each step (N - 1,), in pixels."""
    start = corners(flight.size)
    moved = [apply_homography(flight.homography(i, i + 1), start) - start for i in range(len(flight) - 1)]
    return np.linalg.norm(moved, axis=2).max(1)


@pytest.mark.parametrize("step", [1, 10, -17])
def test_homography_carries_one_frame_into_another(step: int):
    for flight in flights(12):
        i, j = (5, 5 + step) if step > 0 else (30, 30 + step)
        H = flight.homography(i, j)
        warp = lambda image, H=H: cv2.warpPerspective(image, H, SIZE, flags=cv2.INTER_CUBIC)  # noqa: E731
        seen = cv2.erode(warp(np.full(SIZE[::-1], 255, np.uint8)), np.ones((5, 5), np.uint8)) == 255
        assert seen.mean() > 0.1
        expected = flight.frame(j).astype(np.float64)[seen]
        difference = np.abs(warp(flight.frame(i)).astype(np.float64)[seen] - expected).mean()
        shifted = np.abs(np.roll(warp(flight.frame(i)), 1, 1).astype(np.float64)[seen] - expected).mean()
        assert difference < 2.5
        assert difference < 0.6 * shifted  # one pixel off would show


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.tuples(*[st.integers(0, 39)] * 3))
def test_homographies_compose(seed: int, frames: tuple[int, int, int]):
    (flight,) = flights(1, seed=seed)
    i, j, k = frames
    np.testing.assert_allclose(flight.homography(i, i), np.eye(3), atol=1e-9)
    direct, by_way_of_j = flight.homography(i, k), flight.homography(j, k) @ flight.homography(i, j)
    np.testing.assert_allclose(by_way_of_j / by_way_of_j[2, 2], direct, rtol=1e-7, atol=1e-9)
    assert direct.dtype == np.float64
    assert direct[2, 2] == 1


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10**6),
    st.sampled_from([(100, 100), (375, 500), (600, 300), (80, 900), (900, 80), (1500, 2000)]),
    st.sampled_from([(480, 360), (360, 480), (160, 120), (100, 100)]),
)
def test_every_flight_is_smooth(seed: int, shape: tuple[int, int], size: tuple[int, int]):
    (flight,) = flights(1, 60, seed, np.zeros(shape, np.uint8), size)
    motion = corner_motion(flight)
    assert np.isfinite(motion).all()  # no corner is above the horizon, either
    assert motion.max() <= 1.1 * size[0] / 40
    assert motion.max() > 0


def test_tilts_are_bounded():
    paths = [random_path(np.random.default_rng(seed)) for seed in range(2000)]
    largest = np.array([np.abs(path.centre[4:]) + np.abs(path.amplitude[4:]).sum(1) for path in paths])
    assert 0.5 < largest.max() <= 0.65
    assert np.hypot(*largest.T).max() < 0.92


@pytest.mark.parametrize("size", [(480, 360), (360, 360), (200, 600), (600, 200)])
def test_no_horizon_at_the_largest_tilts(monkeypatch: pytest.MonkeyPatch, size: tuple[int, int]):
    amplitude, frequency = np.zeros((6, 3)), np.zeros((6, 3))
    amplitude[4:, 0], frequency[4:, 0] = 0.65, 2 * np.pi / 400
    path = Path6D(amplitude, frequency, np.zeros((6, 3)), np.zeros(6))
    monkeypatch.setattr(plane_flight_module, "random_path", lambda _: path)
    (flight,) = flights(1, 200, size=size)
    # frame 0 looks straight down: it sees whatever is not above a horizon in front of it
    assert np.isfinite([apply_homography(flight.homography(i, 0), corners(size)) for i in range(200)]).all()


def test_motion_of_most_flights():
    motion = np.array([corner_motion(flight) for flight in flights(40, 80, size=(480, 360))])
    assert np.percentile(motion, 99) < 12.5
    assert np.median(motion) > 3  # and they do move
    assert np.percentile(np.median(motion, 1), 90) > 2 * np.percentile(np.median(motion, 1), 10)  # at various speeds


def test_flights_vary():
    last = np.array([flight.homography(0, 79) for flight in flights(60, 80)])
    tilt = np.abs(last[:, 2, :2]).max(1) * SIZE[0]
    zoom = np.sqrt(np.abs(np.linalg.det(last[:, :2, :2])))
    turn = np.degrees(np.abs(np.arctan2(last[:, 1, 0], last[:, 0, 0])))
    for change, much in ((tilt, 0.2), (np.abs(np.log(zoom)), 0.25), (turn, 20)):
        calm, lively = np.percentile(change, [20, 90])
        assert lively > much
        assert lively > 3 * calm


def test_overlap_reaches_far_enough():
    reach = [
        np.median(measure_overlap(flight, OverlapParameters(spacing=48)).reach(0.3))
        for flight in flights(10, 80, size=(480, 360))
    ]
    assert np.mean(np.array(reach) >= 15) >= 0.9


def test_frames_are_reproducible_in_any_order():
    one, other = flights()[3], flights()[3]
    forth = [one.frame(i) for i in range(40)]
    back = [other.frame(i) for i in reversed(range(40))][::-1]
    np.testing.assert_array_equal(forth, back)
    assert (one.name, one.fingerprint) == (other.name, other.fingerprint)
    assert forth[0].shape == (120, 160)
    assert forth[0].dtype == np.uint8


def summary(flight: VirtualFlight) -> tuple[str, str, int, float]:
    return flight.name, flight.fingerprint, int(flight.frame(20).sum()), float(flight.homography(0, 39).sum())


def test_frames_are_the_same_in_another_process():
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        (made_here, made_there) = pool.map(summary, flights(2)), pool.apply(summarise_flights, (2,))
    assert made_here == made_there == [summary(flight) for flight in flights(2)]


def summarise_flights(count: int) -> list[tuple[str, str, int, float]]:
    return [summary(flight) for flight in flights(count)]


def test_flights_differ():
    other_still = [*flights(1, still=STILL[::-1])]
    named = flights_over([("another", STILL)], SIZE, 40, 1, 0)
    made = [*flights(3), *flights(3, seed=1), *other_still, *named]
    assert len({flight.frame(7).tobytes() for flight in made}) == len(made)
    assert len({(flight.name, flight.fingerprint) for flight in made}) == len(made)
    assert [flight.name for flight in made[:2]] == ["still_flight0", "still_flight1"]


def test_fingerprint_changes_with_what_the_frames_depend_on():
    variants = [{}, {"length": 41}, {"size": (160, 121)}, {"seed": 1}, {"still": 255 - STILL}]
    assert len({flights(1, **variant)[0].fingerprint for variant in variants}) == len(variants)


@pytest.mark.parametrize("shape", [(100, 100), (32, 32), (2000, 3000), (600, 300), (40, 1500)])
def test_stills_of_any_size(shape: tuple[int, int]):
    still = texture(*shape) if min(shape) < 1000 else cv2.resize(texture(200, 300), shape[::-1])
    for flight in flights(3, 30, still=still, size=(480, 360)):
        for index in (0, 29):
            frame = flight.frame(index)
            assert frame.shape == (360, 480)
            assert frame.std() > 5  # it shows something


def test_a_huge_still_is_sampled_without_aliasing():
    checks = (np.indices((2000, 3000)).sum(0) % 2 * 255).astype(np.uint8)  # as fine as can be: grey from far
    frame = flights(1, 10, still=checks)[0].frame(5)
    assert abs(float(frame.mean()) - 127.5) < 5
    assert frame.std() < 20


def test_frames_out_of_range():
    (flight,) = flights(1)
    for index in (-1, 40):
        with pytest.raises(IndexError):
            flight.frame(index)
        with pytest.raises(IndexError):
            flight.homography(0, index)


def test_pickles():
    (flight,) = flights(1)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(flight)).frame(9), flight.frame(9))

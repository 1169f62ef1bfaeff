import numpy as np
import pytest
from overlap_rows import rows_of
from overlap_scenes import SCENES
from textured_scenes import ArraySequence, film, flight, texture

from sips_lit.pairs.overlap import OverlapParameters, corners_to_track, measure_overlap
from sips_lit.tracking.klt import KltTracker


def slow_overlap(sequence: ArraySequence, parameters: OverlapParameters) -> tuple[list[list[int]], list[int]]:
    """Survivors of each frame in each later frame, by the set of its own tracks; and the points of each frame."""
    places: dict[int, np.ndarray] = {}  # of the tracks that are alive, by number
    members: list[set[int]] = []  # the tracks that each frame sees
    rows: list[list[int]] = []
    points: list[int] = []
    born = 0
    for index in range(len(sequence)):
        if index:
            numbers = list(places)
            xy = np.array([places[number] for number in numbers], np.float32).reshape(-1, 2)
            moved, held = parameters.tracker.step(sequence.frames[index - 1], sequence.frames[index], xy)
            if held.sum() < parameters.cut_survival * len(held):
                held = np.zeros(len(held), bool)
            places = {number: place for number, place, ok in zip(numbers, moved, held, strict=True) if ok}
        for earlier in range(index):
            unbroken = len(rows[earlier]) == index - earlier - 1
            survivors = len(members[earlier] & set(places))
            if unbroken and survivors and index - earlier <= parameters.max_span:
                rows[earlier].append(survivors)
        xy = np.array(list(places.values()), np.float32).reshape(-1, 2)
        for place in corners_to_track(sequence.frames[index], xy, parameters):
            places[born] = place
            born += 1
        members.append(set(places))
        rows.append([])
        points.append(len(places))
    return rows, points


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("max_span", [200, 3, 1])
def test_as_the_slow_twin(scene, max_span):
    sequence, parameters = SCENES[scene](), OverlapParameters(max_span=max_span)
    index = measure_overlap(sequence, parameters)
    rows, points = slow_overlap(sequence, parameters)
    assert rows_of(index) == rows
    assert index.points.tolist() == points
    assert len(index) == len(sequence)
    assert all((np.diff(row) <= 0).all() for row in rows)
    assert max(map(len, rows), default=0) <= max_span


def test_tracks_end_and_are_replenished():
    index = measure_overlap(SCENES["fast"](), OverlapParameters())
    assert index.points.min() > 30
    assert index.overlap(0)[0] > 0.6
    assert len(index.overlap(0)) < 11  # the first view is left before the end
    assert (index.points.max() - index.points.min()) / index.points.max() < 0.4


def test_overlap_is_about_the_area_in_common():
    sequence = film(14, step=(8, 0), zoom=1.0)
    overlap = measure_overlap(sequence, OverlapParameters()).overlap(0)
    common = 1 - 8 * np.arange(1, 14) / 160
    np.testing.assert_allclose(overlap, common[: len(overlap)], atol=0.15)


def test_a_camera_that_stands_still_sees_everything_again():
    index = measure_overlap(ArraySequence([texture(120, 160)] * 9), OverlapParameters())
    for i in range(8):
        assert len(index.overlap(i)) == 8 - i
        assert index.overlap(i).min() > 0.95
    assert index.reach(0.9).tolist() == [8, 7, 6, 5, 4, 3, 2, 1, 0]


def test_nothing_reaches_across_a_cut():
    index = measure_overlap(SCENES["cut"](), OverlapParameters())
    reach = index.reach(1e-6)
    assert (np.arange(6) + reach[:6] <= 5).all()
    assert reach[0] == 5
    assert reach[6] == 6


def test_every_frame_is_read_once_and_told_of():
    sequence, told = film(5), []
    measure_overlap(sequence, OverlapParameters(), lambda: told.append(None))
    assert sequence.reads == len(told) == 5


def test_signature_changes_with_everything_that_matters():
    sequence, other = film(3), film(3, seed=1)
    base = OverlapParameters().signature(sequence)
    changed = [
        OverlapParameters(spacing=17).signature(sequence),
        OverlapParameters(quality=0.1).signature(sequence),
        OverlapParameters(max_span=9).signature(sequence),
        OverlapParameters(cut_survival=0.2).signature(sequence),
        OverlapParameters(tracker=KltTracker(window=11)).signature(sequence),
        OverlapParameters().signature(other),
    ]
    assert OverlapParameters().signature(film(3)) == base
    assert all(signature != base for signature in changed)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("max_span", [200, 3])
def test_every_overlap_has_a_motion(scene, max_span):
    index = measure_overlap(SCENES[scene](), OverlapParameters(max_span=max_span))
    assert index.motion.shape == (len(index.survivors), 3)
    assert np.isfinite(index.motion).all()


@pytest.mark.parametrize("known", [True, False])
def test_the_motion_is_that_of_the_camera(known):
    sequence = flight(9, step=(4, -3), zoom=1.02, size=(320, 240), known=known)
    truth = flight(9, step=(4, -3), zoom=1.02, size=(320, 240))
    index = measure_overlap(sequence, OverlapParameters())
    for i, later in ((0, 1), (0, 8), (3, 4), (2, 7)):
        H = truth.homography(i, later)
        moved, turn, zoom = index.motion_to(i)[later - i - 1]
        assert zoom == pytest.approx(np.log2(H[0, 0] / H[2, 2]), abs=0.01)
        assert turn == pytest.approx(0, abs=0.3)
        centre = H @ [159.5, 119.5, 1]
        assert moved == pytest.approx(np.hypot(*(centre[:2] / centre[2] - [159.5, 119.5])), rel=0.25)

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from overlap_rows import index_of
from textured_scenes import ArraySequence, film, flight, texture

from sips_lit.errors import BadInputError
from sips_lit.pairs.overlap import OverlapIndex, OverlapParameters, corners_to_track, measure_overlap
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


def rows_of(index: OverlapIndex) -> list[list[int]]:
    return [index.survivors[a:b].tolist() for a, b in zip(index.offsets[:-1], index.offsets[1:], strict=True)]


SCENES = {
    "flight": lambda: film(14),
    "fast": lambda: film(12, step=(14, 6), zoom=1.0),
    "cut": lambda: ArraySequence(film(6).frames + film(7, seed=8).frames),
    "flat": lambda: ArraySequence([np.full((60, 70), 9, np.uint8)] * 4),
    "flat in between": lambda: ArraySequence([*film(4).frames, np.full((120, 160), 9, np.uint8), *film(3).frames]),
    "one frame": lambda: film(1),
    "no frame": lambda: ArraySequence([]),
}


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


@pytest.mark.parametrize("max_span", [200, 3])
@pytest.mark.parametrize("zoom", [0.97, 1.0, 1.05])
def test_known_homographies_tell_the_overlap(zoom, max_span):
    sequence = flight(12, step=(11, 4), zoom=zoom)
    index = measure_overlap(sequence, OverlapParameters(spacing=10, max_span=max_span))
    for i in range(12):
        # each point of a grid by itself: how many frames further it is seen without a break
        reaches = []
        for x in range(5, 160, 10):
            for y in range(5, 120, 10):
                last = i
                while last + 1 < 12:
                    u, v, w = sequence.homography(i, last + 1) @ [x, y, 1]
                    if not (0 <= u / w <= 159 and 0 <= v / w <= 119):
                        break
                    last += 1
                reaches.append(last - i)
        survivors = [sum(reach >= span for reach in reaches) for span in range(1, 12)]
        expected = [count for count in survivors if count][:max_span]
        assert index.points[i] == len(reaches) == 192
        np.testing.assert_allclose(index.overlap(i) * 192, expected)


def test_tracks_and_known_homographies_tell_about_the_same():
    tracked, known = (measure_overlap(scene(12, step=(6, 2)), OverlapParameters()) for scene in (film, flight))
    np.testing.assert_allclose(tracked.overlap(0)[:8], known.overlap(0)[:8], atol=0.15)


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


@given(st.lists(st.lists(st.integers(1, 40), max_size=6), min_size=1, max_size=6), st.floats(0.01, 1.0))
@settings(max_examples=100, deadline=None)
def test_reach_counts_the_frames_with_enough_overlap(rows, overlap):
    rows = [sorted(row, reverse=True) for row in rows]
    points = np.array([max([*row, 1]) for row in rows])
    index = index_of(rows, points)
    for target in (overlap, 0.55, 0.3, 0.1):
        assert index.reach(target).tolist() == [int((index.overlap(i) >= target).sum()) for i in range(len(rows))]


def test_an_overlap_exactly_reached_is_enough():
    for points in range(1, 200):
        for survivors in range(1, points + 1):
            index = index_of([[survivors]], points)
            assert index.reach(survivors / points).tolist() == [1], (survivors, points)


def test_no_overlap_asked_for_is_every_frame_tracked():
    index = index_of([[3, 1], []], [40, 0])
    assert index.reach(0).tolist() == [2, 0]


def test_new_points_keep_away_from_the_others_and_from_flat_places():
    image = texture(96, 128)
    image[:, 64:] = 77
    taken = np.array([[10.2, 11.8], [40, 50]], np.float32)
    fresh = corners_to_track(image, taken, OverlapParameters())
    assert 6 < len(fresh) <= 4 * 6 + 6  # cells of the textured half, and those at its edge
    assert fresh[:, 0].max() < 68
    assert np.abs(fresh[:, None] - taken[None]).max(2).min() >= 4
    for cell in ((0, 0), (3, 2)):
        assert cell not in {(int(y // 16), int(x // 16)) for x, y in fresh}


@pytest.mark.parametrize("contrast", [1, 0.5])
def test_only_corners_are_tracked(contrast):
    """A weak texture, as that of a road, and a straight edge, which slides, are no corners, however dark the video is."""
    image = texture(96, 192).astype(np.float32)
    image[:, 64:] = 128 + (image[:, 64:] - 128) / 12
    image[:, 128:] = np.where(np.arange(64) < 32, 90, 160)
    image = (image * contrast).astype(np.uint8)
    nothing = np.zeros((0, 2), np.float32)
    corners, all_places = (corners_to_track(image, nothing, OverlapParameters(quality=q)) for q in (0.03, 0))
    assert len(all_places) > 40
    assert corners[:, 0].max() < 68
    assert len(corners) > 16


@pytest.mark.parametrize("shape", [(2, 2), (5, 40), (15, 15)])
def test_images_smaller_than_a_cell(shape):
    assert corners_to_track(texture(*shape), np.zeros((0, 2), np.float32), OverlapParameters()).shape == (0, 2)


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


class Unordered(ArraySequence):
    """Views of one plane in no order."""

    temporal = False


def views(*windows: tuple[int, int, int, int]) -> Unordered:
    """Upright views of a plane, one for each window (x, y, W, H) of it."""
    frames = [np.zeros((height, width), np.uint8) for _, _, width, height in windows]
    return Unordered(frames, "views", [np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1.0]]) for x, y, _, _ in windows])


def test_without_an_order_each_pair_is_judged_by_itself_and_sizes_may_differ():
    # a wide view, a small part of it, another part apart from that one, the wide view taller
    sequence = views((0, 0, 160, 120), (10, 10, 40, 40), (100, 60, 60, 40), (0, 0, 160, 200))
    index = measure_overlap(sequence, OverlapParameters(spacing=10))
    assert index.points.tolist() == [16 * 12, 4 * 4, 6 * 4, 16 * 20]
    np.testing.assert_allclose(index.overlap(0) * 192, [16, 24, 192])
    np.testing.assert_allclose(index.overlap(1) * 16, [0, 16])  # nothing in common, then all of it
    np.testing.assert_allclose(index.overlap(2) * 24, [24])
    assert index.reach(0.5).tolist() == [1, 1, 1, 0]
    assert index.partners(0, 0.5).tolist() == [3]
    assert index.partners(0, 0.05).tolist() == [1, 2, 3]
    assert index.partners(1, 0.0).tolist() == [3]
    assert index.partners(3, 0.0).tolist() == []


class Damaged(ArraySequence):
    """Frames ``bad`` can't be read."""

    bad: tuple[int, ...] = ()

    def frame(self, index):
        if index in self.bad:
            raise BadInputError(f"{index}.png is damaged")
        return super().frame(index)


@pytest.mark.parametrize("bad", [(4,), (0,), (8,), (0, 1), (3, 4), (2, 5, 8)])
def test_an_unreadable_frame_is_a_break(bad):
    whole = film(9)
    damaged = Damaged(whole.frames)
    damaged.bad = bad
    index = measure_overlap(damaged, OverlapParameters())
    assert index.unreadable == {i: f"{i}.png is damaged" for i in bad}
    rows, ends = rows_of(index), (-1, *bad, 9)
    for before, after in itertools.pairwise(ends):  # between two breaks: as if nothing else were there
        alone = measure_overlap(ArraySequence(whole.frames[before + 1 : after]), OverlapParameters())
        assert rows[before + 1 : after] == rows_of(alone)
        np.testing.assert_array_equal(index.points[before + 1 : after], alone.points)
    for i in bad:
        assert index.points[i] == 0
        assert rows[i] == []


@pytest.mark.parametrize("bad", [(0,), (2,), (0, 2)])
def test_an_unreadable_view_is_in_no_pair(bad):
    whole = views(*[(10 * i, 5 * i, 160, 120) for i in range(5)])

    class DamagedViews(Damaged):
        temporal = False

    damaged = DamagedViews(whole.frames, "views", whole.to_frame)
    damaged.bad = bad
    index, undamaged = (measure_overlap(sequence, OverlapParameters()) for sequence in (damaged, whole))
    assert index.unreadable == {i: f"{i}.png is damaged" for i in bad}
    for i in range(5):
        expected = [] if i in bad else [j for j in undamaged.partners(i, 0.3) if j not in bad]
        assert index.partners(i, 0.3).tolist() == expected


def test_the_size_of_a_planar_flight_is_that_of_a_frame_that_can_be_read():
    whole = flight(6)
    damaged = Damaged(whole.frames, "flight", whole.to_frame)
    damaged.bad = (0, 1)
    index, undamaged = (measure_overlap(sequence, OverlapParameters()) for sequence in (damaged, whole))
    assert list(index.unreadable) == [0, 1]
    assert not index.reach(0.3)[:2].any()
    assert rows_of(index)[2:] == rows_of(undamaged)[2:]


def test_half_of_the_frames_unreadable_is_too_many():
    damaged = Damaged(film(8).frames, "walk")
    damaged.bad = (1, 3, 6)
    assert len(measure_overlap(damaged, OverlapParameters()).unreadable) == 3
    damaged.bad = (6, 1, 3, 5)
    with pytest.raises(BadInputError, match=r"half of the frames of walk can't be read; the first of them: 1\.png is"):
        measure_overlap(damaged, OverlapParameters())


@pytest.mark.parametrize("scene", SCENES)
def test_parts_of_an_index(scene):
    sequence = SCENES[scene]()
    index = measure_overlap(sequence, OverlapParameters())
    n = len(sequence)
    for start, stop in [(0, n), (0, n // 2), (n // 3, n), (n // 3, n // 2), (n, n)]:
        part = index.part(start, stop)
        expected = [row[: stop - start - i - 1] for i, row in enumerate(rows_of(index)[start:stop])]
        assert rows_of(part) == expected
        np.testing.assert_array_equal(part.points, index.points[start:stop])
        assert part.survivors.dtype == index.survivors.dtype


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


def test_the_motion_of_a_part_is_that_of_the_whole():
    index = measure_overlap(SCENES["flight"](), OverlapParameters())
    part = index.part(3, 9)
    for i in range(6):
        np.testing.assert_array_equal(part.motion_to(i), index.motion_to(i + 3)[: len(part.overlap(i))])


def test_difficulty_tells_overlap_distance_turn_and_zoom_apart():
    easy, steps = (
        (10, (2, 0, 0)),
        [(7, (2, 0, 0)), (10, (9, 0, 0)), (10, (300, 0, 0)), (10, (2, 20, 0)), (10, (2, 60, 0))],
    )
    steps += [(10, (2, 0, 0.4)), (10, (2, 0, 1))]
    alike = [(9, (7, -14, 0.2)), (10, (0, 0, -0.2))]
    row = [easy, *alike, *steps]
    index = index_of([[count for count, _ in row], *([] for _ in row)], motion=[motion for _, motion in row])
    difficulty = index.difficulty(0)
    assert len(set(difficulty[:3])) == 1
    assert len(set(difficulty[2:])) == 8
    mirrored = index_of([[10, 10, 10], [], [], []], motion=[(2, -20, -0.4), (2, 20, 0.4), (2, 20, -0.4)])
    assert len(set(mirrored.difficulty(0))) == 1


def test_overlap_within_bounds():
    index = index_of([[10, 6, 5, 3], [9, 6, 1], [5, 2], [0], []])
    assert index.reach(0.3, 0.6).tolist() == [2, 0, 1, 0, 0]
    assert index.partners(0, 0.3, 0.6).tolist() == [3, 4]
    for i in range(5):
        assert len(index.partners(i, 0.3, 0.6)) == index.reach(0.3, 0.6)[i]
    assert (index.reach(0.3, 0.6) + index.reach(0.6)).tolist() == index.reach(0.3).tolist()


def there_and_back(*windows: tuple[int, int, int, int]) -> ArraySequence:
    """As `views`, in the order in which a moving camera saw them."""
    unordered = views(*windows)
    return ArraySequence(unordered.frames, "there and back", unordered.to_frame)


def test_what_left_the_view_of_a_moving_camera_does_not_come_back():
    """10 x 10 points, 16 px apart; the camera goes 80 px to the right, half of the way back, and all of it."""
    sequence = there_and_back(*[(x, 0, 160, 160) for x in (0, 80, 40, 0)])
    index = measure_overlap(sequence, OverlapParameters())
    assert rows_of(index) == [[50, 50, 50], [70, 50], [70], []]
    assert index.motion_to(0)[:, 0].tolist() == [80, 40, 0]
    # in no order each pair stands for itself
    unordered = measure_overlap(views(*[(x, 0, 160, 160) for x in (0, 80, 40, 0)]), OverlapParameters())
    assert rows_of(unordered) == [[50, 80, 100], [70, 50], [70], []]
    assert unordered.motion.tolist() == [[pixels, 0, 0] for pixels in (80, 40, 0, 40, 80, 40)]


@pytest.mark.parametrize(("shift", "seen"), [(8, 3), (9, 2), (-7, 3), (-8, 2)])
def test_points_are_in_view_up_to_the_centres_of_the_border_pixels(shift, seen):
    """Columns 8, 24 and 40 of 48: the border is reached exactly, or passed by a pixel."""
    for windows in (((0, 0, 48, 16), (shift, 0, 48, 16)), ((0, 0, 16, 48), (0, shift, 16, 48))):
        assert rows_of(measure_overlap(there_and_back(*windows), OverlapParameters())) == [[seen], []]


def test_points_behind_the_camera_are_not_in_view():
    """The horizon of the second view is at x = 16 of the first: of 24 and 40, the map of which is inside, none is seen."""
    H = np.array([[1.0, 0, -200], [0, -1, 0], [-1 / 16, 0, 1]])
    mapped = [(H @ [x, 8, 1])[:2] / (H @ [x, 8, 1])[2] for x in (24, 40)]
    assert all(0 <= x <= 399 and 0 <= y <= 399 for x, y in mapped)
    frames = [np.zeros((16, 48), np.uint8), np.zeros((400, 400), np.uint8)]
    scene = Unordered(frames, "horizon", [np.eye(3), H])
    assert rows_of(measure_overlap(scene, OverlapParameters())) == [[0], []]


def test_the_overlap_is_a_share_of_the_points_of_the_earlier_frame():
    index = index_of([[8, 4], [6], []], [10, 20, 30])
    assert index.overlap(0).tolist() == [0.8, 0.4]
    assert index.overlap(1).tolist() == [0.3]
    assert index.reach(0.3).tolist() == [2, 1, 0]
    assert index.partners(0, 0.4).tolist() == [1, 2]


def test_new_points_are_on_the_corners_of_the_image():
    """Bright squares 2 px wide at known places, one in a cell: their middles are between four pixels."""
    image = np.full((64, 128), 40, np.uint8)
    corners = [(20, 10), (54, 38), (100, 22), (116, 52)]
    for x, y in corners:
        image[y : y + 2, x : x + 2] = 240
    found = corners_to_track(image, np.zeros((0, 2), np.float32), OverlapParameters())
    assert len(found) >= 4
    for x, y in corners:
        assert np.abs(found - [x + 0.5, y + 0.5]).max(1).min() <= 2
    assert all(min(np.hypot(px - x, py - y) for x, y in corners) < 4 for px, py in found)


@pytest.mark.parametrize("flip", [np.fliplr, np.flipud])
def test_new_points_of_a_mirrored_image_are_mirrored(flip):
    """A place that is half a pixel off on one side is half a pixel off on the other."""
    image = texture(96, 128)
    nothing = np.zeros((0, 2), np.float32)
    straight, turned = (
        corners_to_track(np.ascontiguousarray(seen), nothing, OverlapParameters()) for seen in (image, flip(image))
    )
    axis = 0 if flip is np.fliplr else 1
    turned[:, axis] = image.shape[1 - axis] - 1 - turned[:, axis]
    assert len(straight) > 30
    assert sorted(turned.tolist()) == sorted(straight.tolist())


def test_one_lamp_does_not_hide_the_corners_of_a_dark_image():
    image = (texture(96, 128) // 8).astype(np.uint8)
    lit = image.copy()
    lit[38:42, 70:74] = 255  # inside a cell
    nothing = np.zeros((0, 2), np.float32)
    dark, bright = ({*map(tuple, corners_to_track(i, nothing, OverlapParameters()).tolist())} for i in (image, lit))
    apart = {place for place in dark if np.hypot(place[0] - 72, place[1] - 40) > 16}
    assert len(apart) > 30
    assert len(apart & bright) >= len(apart) - 2


def test_a_part_tells_of_its_own_unreadable_frames_by_their_numbers_in_it():
    index = index_of([[3, 1], [], [], [2], [], [4], []], unreadable={1: "b", 2: "c", 4: "e", 6: "g"})
    assert index.part(2, 6).unreadable == {0: "c", 2: "e"}
    assert index.part(0, 7).unreadable == index.unreadable
    assert index.part(5, 6).unreadable == {}

import pickle
from collections import Counter

import numpy as np
import pytest
from overlap_rows import index_of
from textured_scenes import ArraySequence, flight

from sips_lit.errors import BadInputError
from sips_lit.pairs.sampler import PairChoice, PairSampler, read_pair
from sips_lit.types import Camera

FIRST = index_of([[9, 6, 2], [8], [1], []], 10)  # at 0.5: 0-1, 0-2, 1-2
SECOND = index_of([[4], [7, 5], [2], [10], []], 10)  # at 0.5: 1-2, 1-3, 3-4
PAIRS = {(0, 0, 1), (0, 0, 2), (0, 1, 2), (1, 1, 2), (1, 1, 3), (1, 3, 4)}


def test_exactly_the_eligible_pairs_occur_in_both_orders():
    sampler = PairSampler([FIRST, SECOND], 0.5, seed=0)
    drawn = {(c.sequence, c.index0, c.index1) for c in (sampler.draw(0, i) for i in range(400))}
    assert drawn == PAIRS | {(s, b, a) for s, a, b in PAIRS}


def test_frames_are_equally_likely_and_so_are_partners_and_orders():
    sampler = PairSampler([FIRST, SECOND], 0.5, seed=1)
    n = 3000
    drawn = [sampler.draw(0, i) for i in range(n)]
    first = Counter((c.sequence, min(c.index0, c.index1)) for c in drawn)
    for frame in ((0, 0), (0, 1), (1, 1), (1, 3)):
        assert abs(first[frame] - n / 4) < 4 * np.sqrt(n * 0.25 * 0.75)
    partner = Counter(max(c.index0, c.index1) for c in drawn if (c.sequence, min(c.index0, c.index1)) == (0, 0))
    assert abs(partner[1] - partner[2]) < 4 * np.sqrt(n / 4)
    assert abs(sum(c.index0 < c.index1 for c in drawn) - n / 2) < 4 * np.sqrt(n / 4)


@pytest.mark.parametrize("left_out", [0, 1, 3])
@pytest.mark.parametrize("spread", [0, 0.5, 1])
def test_how_evenly_difficulties_are_drawn_whatever_the_number_of_frames_of_each(left_out, spread):
    """Of one frame's ten partners eight overlap alike, as seen by a camera that is slow; one of the others is turned.

    The frames before the first partner are left out: they show something else.
    """
    rows = [[1] * left_out + [10] * 9 + [5], *([] for _ in range(left_out + 10))]
    motion = [[90, 20, 1]] * left_out + [[2, 0, 0]] * 8 + [[2, 60, 0]] + [[40, 0, 0]]
    sampler, n = PairSampler([index_of(rows, motion=motion)], 0.3, seed=2, spread=spread), 3000
    drawn = (sampler.draw(0, i) for i in range(n))
    partner = Counter(max(c.index0, c.index1) - left_out for c in drawn)
    whole = 8 ** (1 - spread) + 2
    for alike in (range(1, 9), [9], [10]):
        p = len(alike) ** (1 - spread) / whole
        assert abs(sum(partner[j] for j in alike) - n * p) < 4 * np.sqrt(n * p * (1 - p))
    p = 8**-spread / whole  # alike ones are equally likely
    assert all(abs(partner[j] - n * p) < 4 * np.sqrt(n * p) for j in range(1, 9))


def test_a_draw_depends_on_seed_epoch_and_index_only():
    one, other = PairSampler([FIRST, SECOND], 0.5, seed=7), PairSampler([FIRST, SECOND], 0.5, seed=7)
    draws = [one.draw(2, i) for i in range(50)]
    assert [other.draw(2, i) for i in reversed(range(50))] == draws[::-1]
    assert [one.draw(3, i) for i in range(50)] != draws
    assert [PairSampler([FIRST, SECOND], 0.5, seed=8).draw(2, i) for i in range(50)] != draws


def test_a_sampler_can_be_sent_to_a_worker_and_draws_there_the_same():
    sampler = PairSampler([FIRST, SECOND], 0.5, seed=7)
    sent = pickle.loads(pickle.dumps(sampler))
    assert [sent.draw(0, i) for i in range(20)] == [sampler.draw(0, i) for i in range(20)]


def test_global_random_state_is_neither_used_nor_changed():
    sampler = PairSampler([FIRST], 0.5, seed=0)
    before = np.random.get_state()[1].copy()  # noqa: NPY002 - the point of the test
    draws = [sampler.draw(0, i) for i in range(10)]
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    np.random.seed(5)  # noqa: NPY002
    assert [sampler.draw(0, i) for i in range(10)] == draws


def test_no_pair_names_the_data_and_the_most_found():
    with pytest.raises(BadInputError, match=r"no two frames of walk, drive overlap by 0\.95: the most found is 0\.90"):
        PairSampler([FIRST, index_of([[3], []])], 0.95, seed=0, names=["walk", "drive"])


@pytest.mark.parametrize("indexes", [[], [index_of([[], []])], [index_of([])]])
def test_no_overlap_at_all(indexes):
    with pytest.raises(BadInputError, match=r"no two frames of the data .* the most found is 0\.00"):
        PairSampler(indexes, 0.3, seed=0)


@pytest.mark.parametrize(("first", "last", "between"), [(2, 6, [3, 4, 5]), (6, 2, [5, 4, 3]), (4, 5, []), (5, 4, [])])
def test_frames_in_order_and_complete(short_flight, first, last, between):
    pair = read_pair(short_flight, first, last)
    expected = [short_flight.frames[i] for i in [first, *between, last]]
    assert len(pair.frames) == len(expected)
    assert all(np.array_equal(a, b) for a, b in zip(pair.frames, expected, strict=True))
    np.testing.assert_array_equal(pair.image0, short_flight.frames[first])
    np.testing.assert_array_equal(pair.image1, short_flight.frames[last])
    assert (pair.name, pair.index0, pair.index1) == (f"flight:{first}-{last}", first, last)
    np.testing.assert_allclose(pair.homography, short_flight.homography(first, last))
    assert pair.geometry is None


def test_without_the_frames_between():
    scene = flight(9)
    pair = read_pair(scene, 7, 1, between=False)
    assert scene.reads == 2
    assert len(pair.frames) == 2
    np.testing.assert_array_equal(pair.frames[0], scene.frames[7])
    np.testing.assert_array_equal(pair.image1, scene.frames[1])


class Posed(ArraySequence):
    """Moves 0.5 m along x a frame; ``lacks`` leaves parts of the truth out."""

    lacks: tuple[str, ...] = ()

    def camera(self, index):
        return None if "camera" in self.lacks else Camera(np.eye(3), (160, 120))

    def pose(self, index):
        T_world_camera = np.eye(4)
        T_world_camera[0, 3] = 0.5 * index
        return None if "pose" in self.lacks else T_world_camera

    def depth(self, index):
        return None if f"depth{index}" in self.lacks else np.full((120, 160), 2.0 + index)


def test_geometry_maps_points_of_the_first_frame_into_the_second():
    geometry = read_pair(Posed(flight(4).frames), 1, 3).geometry
    assert geometry is not None
    np.testing.assert_allclose(geometry.T_1_0 @ [0, 0, 5, 1], [-1, 0, 5, 1])  # the camera moved right, the point left
    assert (geometry.depth0[0, 0], geometry.depth1[0, 0]) == (3, 5)


@pytest.mark.parametrize("lacks", [("depth0",), ("depth2",), ("depth0", "depth2"), ("pose",), ("camera",)])
def test_geometry_has_what_the_sequence_knows(lacks):
    sequence = Posed(flight(3).frames)
    sequence.lacks = lacks
    geometry = read_pair(sequence, 0, 2).geometry
    assert (geometry is None) == ("camera" in lacks)
    if geometry is not None:
        assert (geometry.T_1_0 is None) == ("pose" in lacks)
        assert (geometry.depth0 is None) == ("depth0" in lacks)
        assert (geometry.depth1 is None) == ("depth2" in lacks)


class Stereo(Posed):
    def depth(self, index):
        return None

    def right(self, index):
        return self.frame(index)[:, ::-1]

    def baseline(self):
        return 0.3


def test_right_images_stand_in_for_depth_maps():
    sequence = Stereo(flight(3).frames)
    geometry = read_pair(sequence, 0, 2).geometry
    assert geometry.baseline == 0.3
    np.testing.assert_array_equal(geometry.right1, sequence.right(2))
    without = read_pair(sequence, 0, 2, depth=False).geometry
    assert without.right0 is None
    assert without.T_1_0 is not None


def test_choices_are_values():
    assert PairChoice(0, 1, 2) == PairChoice(0, 1, 2)
    assert len({PairChoice(0, 1, 2), PairChoice(0, 1, 2), PairChoice(0, 2, 1)}) == 2


def test_partners_of_unordered_frames_need_not_be_the_next_ones():
    index = index_of([[2, 9, 0, 7], [0, 0, 10], [9], [1], []])  # at 0.5: 0-2, 0-4, 1-4, 2-3
    sampler = PairSampler([FIRST, index], 0.5, seed=3)
    drawn = {(c.index0, c.index1) for c in (sampler.draw(0, i) for i in range(400)) if c.sequence == 1}
    assert {tuple(sorted(pair)) for pair in drawn} == {(0, 2), (0, 4), (1, 4), (2, 3)}


def test_only_pairs_below_a_bound():
    sampler = PairSampler([FIRST, SECOND], 0.3, seed=1, below=0.8)
    drawn = {(c.sequence, *sorted((c.index0, c.index1))) for c in (sampler.draw(0, i) for i in range(200))}
    assert drawn == {(0, 0, 2), (1, 0, 1), (1, 1, 2), (1, 1, 3)}
    assert sampler.pair_count == len(list(sampler.all_pairs())) == 4
    with pytest.raises(
        BadInputError, match=r"no two frames of the data overlap by 0\.91 and less than 0\.95: the most"
    ):
        PairSampler([FIRST], 0.91, seed=1, below=0.95)


class Turning(Stereo):
    """Frame i is at (i, 0, 0), turned by i right angles about the vertical axis, with a focal length of its own."""

    def camera(self, index):
        return Camera(np.diag([100.0 + index, 100, 1]), (160, 120))

    def pose(self, index):
        T = np.eye(4)
        c, s = [(1, 0), (0, 1), (-1, 0)][index]
        T[0, 0], T[0, 2], T[2, 0], T[2, 2], T[0, 3] = c, s, -s, c, index
        return T


def test_the_motion_is_that_of_the_camera_in_its_own_frame():
    """Frame 1 looks along the x axis of the world from (1, 0, 0): what is at (4, 0, 0) is 3 m ahead of it."""
    geometry = read_pair(Turning(flight(3).frames), 0, 1).geometry
    np.testing.assert_allclose(geometry.T_1_0 @ [4, 0, 0, 1], [0, 0, 3, 1], atol=1e-12)
    back = read_pair(Turning(flight(3).frames), 1, 0).geometry
    np.testing.assert_allclose(back.T_1_0 @ [0, 0, 3, 1], [4, 0, 0, 1], atol=1e-12)
    # neither camera is that of the world: frame 2 looks back along z from (2, 0, 0); (4, 0, -3) is 3 m ahead of both
    further = read_pair(Turning(flight(3).frames), 1, 2).geometry
    np.testing.assert_allclose(further.T_1_0 @ [3, 0, 3, 1], [-2, 0, 3, 1], atol=1e-12)


def test_each_frame_has_its_own_camera_and_partner():
    sequence = Turning(flight(3).frames)
    geometry = read_pair(sequence, 0, 2).geometry
    assert (geometry.camera0.matrix[0, 0], geometry.camera1.matrix[0, 0]) == (100, 102)
    np.testing.assert_array_equal(geometry.right0, sequence.right(0))
    np.testing.assert_array_equal(geometry.right1, sequence.right(2))


@pytest.mark.parametrize("lacking", [0, 2])
def test_a_partner_is_read_where_there_is_no_depth_map(lacking):
    class Both(Turning):
        def depth(self, index):
            return None if index == lacking else np.full((120, 160), 2.0)

    geometry = read_pair(Both(flight(3).frames), 0, 2).geometry
    assert (geometry.right0 is None, geometry.right1 is None) == (lacking == 2, lacking == 0)
    assert (geometry.depth0 is None, geometry.depth1 is None) == (lacking == 0, lacking == 2)
    assert geometry.baseline == 0.3


def test_a_draw_is_one_of_all_frames_with_a_partner_in_their_order():
    indexes = [index_of([[], []]), FIRST, index_of([[1], []]), SECOND, FIRST]
    sampler = PairSampler(indexes, 0.5, seed=11)
    eligible = [(at, i) for at, index in enumerate(indexes) for i in range(len(index)) if len(index.partners(i, 0.5))]
    drawn = [sampler.draw(1, number) for number in range(200)]
    for number, pair in enumerate(drawn):
        expected = eligible[np.random.default_rng([11, 1, number]).integers(len(eligible))]
        assert (pair.sequence, min(pair.index0, pair.index1)) == expected
    assert {pair.sequence for pair in drawn} == {1, 3, 4}
    every = [(pair.sequence, pair.index0) for pair in sampler.all_pairs()]
    assert sorted(set(every)) == eligible
    assert len(every) == sampler.pair_count

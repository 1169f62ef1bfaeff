import numpy as np
from wall_scene import Wall

from sips_lit.frames.frame_cache import CachedSequence, FrameCache


def test_a_frame_is_read_once():
    wall = Wall(3, stereo=True)
    sequence = CachedSequence(wall, FrameCache())
    for _ in range(3):
        for index in range(3):
            np.testing.assert_array_equal(sequence.frame(index), wall._crop(8 * index, 4 * index))
    assert wall.reads == 3


def test_everything_is_passed_on():
    wall = Wall(3, stereo=True)
    sequence = CachedSequence(wall, FrameCache())
    assert len(sequence) == 3
    assert (sequence.name, sequence.fingerprint) == (wall.name, wall.fingerprint)
    assert sequence.frame_name(2) == wall.frame_name(2)
    assert sequence.baseline() == 1.6
    assert sequence.time(0) is None
    assert sequence.homography(0, 1) is None
    assert sequence.temporal
    wall.temporal = False
    assert not CachedSequence(wall, FrameCache()).temporal
    np.testing.assert_array_equal(sequence.pose(2), wall.pose(2))
    np.testing.assert_array_equal(sequence.depth(1), wall.depth(1))
    np.testing.assert_array_equal(sequence.right(1), wall.right(1))
    np.testing.assert_array_equal(sequence.camera(1).matrix, wall.camera(1).matrix)


def test_what_is_not_there_is_cached_too():
    wall = Wall(3, depth=False)
    sequence = CachedSequence(wall, FrameCache())
    assert sequence.depth(0) is None
    wall.tells_depth = True
    assert sequence.depth(0) is None


def test_the_oldest_is_dropped_beyond_the_limit():
    cache = FrameCache(limit=250)
    read = []

    def get(key):
        def load():
            read.append(key)
            return np.full(100, key, np.uint8)

        assert cache.get(key, load)[0] == key
        assert cache.held <= 250

    for key in (1, 2, 1, 3, 1, 2):
        get(key)
    assert read == [1, 2, 3, 2]


def test_sequences_do_not_mix():
    cache = FrameCache()
    one, two = (CachedSequence(Wall(2, seed=seed), cache) for seed in (0, 1))
    assert (one.frame(0) != two.frame(0)).any()

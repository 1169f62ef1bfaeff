import math

import numpy as np
import pytest
from wall_scene import Wall

from sips_lit.errors import BadInputError
from sips_lit.evaluate.features import image_key
from sips_lit.evaluate.pair_set import PairSet
from sips_lit.frames.frame_cache import FrameCache
from sips_lit.frames.source import Source
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.klt import KltInliers
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.pairs.choice import ListedPair


def test_true_motions():
    pairs = PairSet([Source([Wall(6)])], [ListedPair(0, 0, 2, 0.9), ListedPair(0, 4, 1, math.nan)], PoseDepthInliers())
    table = pairs.table()
    np.testing.assert_allclose(table.rotation, 0, atol=1e-12)
    np.testing.assert_allclose(table.translation, [math.hypot(1.6, 0.8), math.hypot(2.4, 1.2)], rtol=1e-9)
    assert table.name == ("wall:0-2", "wall:4-1")
    unknown = PairSet([Source([Wall(6, poses=False)])], [ListedPair(0, 0, 2, 0.9)], PoseDepthInliers()).table()
    assert np.isnan(unknown.rotation).all()
    assert np.isnan(unknown.translation).all()


def test_a_right_angle():
    wall = Wall(2)
    turned = np.eye(4)
    turned[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    wall.pose = lambda index: turned if index else np.eye(4)
    table = PairSet([Source([wall])], [ListedPair(0, 0, 1, 1)], PoseDepthInliers()).table()
    assert table.rotation == pytest.approx([90])
    assert table.translation == pytest.approx([0])


def test_frames_and_their_keys():
    wall = Wall(6)
    listed = [ListedPair(0, 4, 1, 1), ListedPair(0, 1, 2, 1)]
    pairs = PairSet([Source([wall])], listed, PoseDepthInliers())
    assert pairs.frames() == [(0, 1), (0, 2), (0, 4)]
    assert pairs.key_of((0, 4)) == image_key(wall.frame(4))
    pair = pairs.read(0, depth=False)
    assert (pair.index0, pair.index1) == (4, 1)
    assert len(pair.frames) == 2  # nothing between: the check needs none
    assert pair.geometry.depth0 is not None  # the check needs it


def test_sizes_of_the_frames_that_are_used():
    wall = Wall(3)
    whole = wall.frame
    wall.frame = lambda index: whole(index)[: 120 - 10 * index]
    protocol = PairSet([Source([wall])], [ListedPair(0, 1, 2, 1)], PoseDepthInliers()).protocol
    assert protocol["image_size"] == ["160x100", "160x110"]


def test_pair_sets_share_a_cache():
    wall, cache = Wall(6), FrameCache()
    for _ in range(2):
        PairSet([Source([wall])], [ListedPair(0, 0, 2, 1)], PoseDepthInliers(), cache).read(0, depth=False)
    assert wall.reads == 2


def test_images_in_no_order_are_not_tracked_through():
    wall = Wall(3)
    wall.temporal = False
    pairs = PairSet([Source([wall])], [ListedPair(0, 0, 2, 1)], KltInliers())
    with pytest.raises(BadInputError, match="in no order"):
        pairs.read(0, depth=False)


def test_no_pairs():
    with pytest.raises(BadInputError, match="no pairs"):
        PairSet([Source([Wall(6)])], [], PoseDepthInliers())


def test_each_source_has_its_own_check(flights):
    sequences, listed = flights
    sources = [Source(sequences[:1], inliers=HomographyInliers(1.5)), Source(sequences[1:])]
    pairs = PairSet(sources, listed, HomographyInliers(3.0))
    assert {pairs.listed[at].sequence: pairs.check(at).threshold for at in range(len(pairs))} == {0: 1.5, 1: 3.0}

import runpy
from pathlib import Path

import numpy as np
import pytest
from overlap_rows import index_of
from stereo_scenes import CAMERA, StereoScene, pose

from sips_lit.geometry.projection import View, frame_view
from sips_lit.geometry.stereo import StereoMatcher

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "overlap_geometry.py"))
visible_share, draw_pairs, rank_correlation = SCRIPT["visible_share"], SCRIPT["draw_pairs"], SCRIPT["rank_correlation"]
IMAGE = np.zeros((240, 320), np.uint8)


def wall(distance: float) -> View:
    return View(IMAGE, CAMERA, np.full(IMAGE.shape, distance, np.float32), None, None)


def test_the_share_by_hand():
    """A wall 5 m away and a camera that moves 1 m to the right: everything goes 50 px to the left."""
    xy = np.array([[20.0, 50], [60, 50], [200, 100], [49, 9], [51, 9]])
    share, known = visible_share(wall(5), wall(5), pose(-1, 0, 0, 0), xy, StereoMatcher())
    assert (share, known) == (3 / 5, 5)
    holes = wall(5)
    holes.depth[50] = np.nan
    assert visible_share(holes, wall(5), pose(-1, 0, 0, 0), xy, StereoMatcher()) == (2 / 3, 3)


def test_what_is_hidden_or_behind_is_not_seen():
    xy = np.array([[100.0, 50], [200, 100]])
    assert visible_share(wall(5), wall(4), np.eye(4), xy, StereoMatcher())[0] == 0
    assert visible_share(wall(5), wall(4.6), np.eye(4), xy, StereoMatcher())[0] == 1  # within a tenth
    assert visible_share(wall(5), wall(5), pose(0, 0, -6, 0), xy, StereoMatcher())[0] == 0
    nothing = wall(np.nan)
    assert visible_share(nothing, wall(5), np.eye(4), xy, StereoMatcher())[1] == 0
    assert visible_share(wall(5), nothing, np.eye(4), xy, StereoMatcher())[0] == 1  # nothing is known to hide them


def test_depth_maps_and_stereo_tell_the_same_share():
    """Of the points whose depth both tell; more is hidden from both cameras of a stereo pair."""
    scenes = [StereoScene(4, tells) for tells in ("stereo", "depth")]
    T = np.linalg.inv(scenes[0].poses[3]) @ scenes[0].poses[0]
    stereo, depth = [(frame_view(scene, 0), frame_view(scene, 3)) for scene in scenes]
    xy = SCRIPT["corners_to_track"](stereo[0].image, np.zeros((0, 2), np.float32), SCRIPT["OverlapParameters"]())
    xy = xy[np.isfinite(stereo[0].depth_at(xy, StereoMatcher()))]
    shares = [visible_share(*both, T, xy, StereoMatcher())[0] for both in (stereo, depth)]
    assert len(xy) > 100
    assert shares[0] == pytest.approx(shares[1], abs=0.08)
    assert 0.5 < shares[1] < 0.98


def test_pairs_are_different_and_those_that_have_tracks():
    first, second = index_of([[5, 4, 1], [3], [], []], 9), index_of([[2], [3, 3], [1], []], 9)
    pairs = draw_pairs([first, second], 99, 0)
    assert sorted(pairs) == [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    assert len(draw_pairs([first, second], 2, 0)) == 2
    assert draw_pairs([index_of([[], []])], 5, 0) == []


def test_rank_correlation():
    assert rank_correlation([1, 2, 3, 4], [10, 20, 25, 1000]) == pytest.approx(1)
    assert rank_correlation([1, 2, 3, 4], [4, 3, 2, 1]) == pytest.approx(-1)
    # ranks 0, 1.5, 1.5, 3 and 0, 1, 2, 3
    assert rank_correlation([1, 5, 5, 7], [1, 2, 3, 4]) == pytest.approx(4.5 / np.sqrt(4.5 * 5))
    assert np.isnan(rank_correlation([1, 1], [1, 2]))
    assert np.isnan(rank_correlation([], []))


def test_a_made_scene_from_end_to_end():
    pairs = list(SCRIPT["measure_pairs"](StereoScene(4, "depth"), 6, 0))
    assert len(pairs) == 6
    for pair in pairs:
        assert pair.metres == pytest.approx(pair.gap * np.linalg.norm([0.12, 0.04, 0.25]), rel=0.01)
        assert pair.overlaps[0] == pytest.approx(pair.visible, abs=0.25)
    table = SCRIPT["rows"](pairs)
    assert sum(row[2] for row in table if row[0] == "corners") == 6
    assert all(len(row) == len(SCRIPT["HEADERS"]) for row in table)

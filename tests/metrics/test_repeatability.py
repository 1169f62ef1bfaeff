import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from textured_scenes import keypoints

from sips_lit.geometry.stereo import StereoMatcher
from sips_lit.metrics.repeatability import MovedPoints, move_points, repeated
from sips_lit.types import Camera, FramePair, Keypoints, Matches, ViewGeometry

NO_MATCH = Matches(np.zeros(0, np.int64), np.zeros(0, np.int64))
IMAGE = np.zeros((100, 200), np.uint8)
NO_POINTS = Keypoints.empty()


def points(*xy) -> np.ndarray:
    return np.array(xy, np.float64).reshape(-1, 2)


def planar(H) -> FramePair:
    return FramePair("p", 0, 1, (IMAGE, IMAGE), IMAGE, IMAGE, np.array(H, float))


def shifted(dx: float) -> FramePair:
    return planar([[1, 0, dx], [0, 1, 0], [0, 0, 1]])


def measure(pair, xy0, xy1, matches=NO_MATCH, threshold=3.0):
    return repeated(xy0, xy1, *move_points(pair, keypoints(xy0), keypoints(xy1), StereoMatcher()), matches, threshold)


def test_counted_by_hand():
    # moved by 50: (180, 50) leaves image 1; (20, 90) of image 1 comes from outside of image 0
    xy0 = points((10, 10), (40, 40), (100, 80), (180, 50))
    xy1 = points((60, 12), (90, 44), (150, 80), (20, 90), (120, 20))
    matches = Matches(np.array([0, 1, 3]), np.array([0, 1, 2]))
    result = measure(shifted(50), xy0, xy1, matches)
    # three points of image 0 and four of image 1 are in the common view; 2 px and 0 px are near, 4 px is not
    assert result.repeatability == pytest.approx(2 / 3)
    assert result.matching_score == pytest.approx(1 / 3)
    assert measure(shifted(50), xy0, xy1, matches, 4.0).repeatability == 1
    assert measure(shifted(50), xy0, xy1, matches, 4.0).matching_score == pytest.approx(2 / 3)


def test_a_point_that_is_not_seen_corresponds_to_none_however_near():
    # (151, 50) would be at (201, 50), beyond the last column; (199, 50) is 2 px from there
    xy0, xy1 = points((10, 10), (151, 50)), points((100, 90), (199, 50))
    result = measure(shifted(50), xy0, xy1, Matches(np.array([1]), np.array([1])))
    assert (result.repeatability, result.matching_score) == (0, 0)


def test_each_image_has_its_own_size():
    wide = np.zeros((100, 300), np.uint8)
    pair = FramePair("p", 0, 1, (IMAGE, wide), IMAGE, wide, np.array([[1.0, 0, 100], [0, 1, 0], [0, 0, 1]]))
    given0, given1 = keypoints(points((150, 50))), keypoints(points((250, 50), (90, 50), (299, 50)))
    moved0, moved1 = move_points(pair, given0, given1, StereoMatcher())
    assert moved0.visible.tolist() == [True]  # at (250, 50): image 0 ends before
    assert moved1.visible.tolist() == [True, False, True]
    np.testing.assert_allclose(moved1.xy, [[150, 50], [-10, 50], [199, 50]])
    # the other way: (190, 50) of image 1 is at (210, 50), beyond image 0 though not beyond image 1
    left = FramePair("p", 0, 1, (IMAGE, wide), IMAGE, wide, np.array([[1.0, 0, -20], [0, 1, 0], [0, 0, 1]]))
    assert move_points(left, NO_POINTS, keypoints(points((190, 50))), StereoMatcher())[1].visible.tolist() == [False]


@pytest.mark.parametrize(
    ("x", "y", "seen"),
    [
        (-0.4, 50, True),
        (-0.6, 50, False),
        (199.4, 50, True),
        (199.6, 50, False),
        (9, -0.4, True),
        (9, -0.6, False),
        (9, 99.4, True),
        (9, 99.6, False),
    ],
)
def test_pixels_reach_half_a_pixel_beyond_their_centres(x, y, seen):
    moved, _ = move_points(shifted(0), keypoints(points((x, y))), NO_POINTS, StereoMatcher())
    assert moved.visible.tolist() == [seen]


def test_many_points_in_one_place_count_once():
    xy0, xy1 = points((50, 50)), points((50, 50), (50.5, 50), (51, 50), (50, 51))
    assert measure(shifted(0), xy0, xy1).repeatability == 1
    crowd = points((50, 50), (50.5, 50), (51, 50), (120, 20))
    assert measure(shifted(0), crowd, points((50, 50), (10, 80), (10, 90), (10, 70))).repeatability == 1 / 4


def test_the_larger_distance_of_both_images_counts():
    zoom = planar([[2, 0, 0], [0, 2, 0], [0, 0, 1]])
    # 2 px apart in image 0 and 4 px in image 1
    assert measure(zoom, points((20, 20)), points((44, 40))).repeatability == 0
    assert measure(zoom, points((20, 20)), points((42, 40))).repeatability == 1


@pytest.mark.parametrize("empty", [0, 1, 2])
def test_no_points(empty):
    xy = [points((50, 50)), points((50, 50))]
    for image in (0, 1):
        if empty in (image, 2):
            xy[image] = points()
    result = measure(shifted(0), *xy)
    assert (result.repeatability, result.matching_score) == (0, 0)


def test_nothing_in_the_common_view():
    assert measure(shifted(500), points((5, 5)), points((6, 6))).repeatability == 0


def test_no_truth():
    assert move_points(FramePair("p", 0, 1, (IMAGE,), IMAGE, IMAGE), NO_POINTS, NO_POINTS, StereoMatcher()) is None
    unknown = MovedPoints(np.full((2, 2), np.nan), np.zeros(2, bool), np.zeros(2, bool))
    known = MovedPoints(points((1, 1)), np.ones(1, bool), np.ones(1, bool))
    assert math.isnan(repeated(points((1, 1), (2, 2)), points((1, 1)), unknown, known, NO_MATCH).repeatability)


def stereo(depth0, depth1) -> FramePair:
    """Camera 1 is 1 m to the right: at depth z a point moves by 100 / z to the left."""
    camera = Camera(np.array([[100.0, 0, 100], [0, 100, 50], [0, 0, 1]]), (200, 100))
    T = np.eye(4)
    T[0, 3] = -1
    return FramePair("p", 0, 1, (IMAGE, IMAGE), IMAGE, IMAGE, None, ViewGeometry(T, camera, camera, depth0, depth1))


def test_by_depth():
    depth = np.full((100, 200), 10.0)
    depth[:, :100] = 5.0
    depth[:50, 150:] = np.nan
    pair = stereo(depth, None)
    xy0 = points((120, 20), (60, 20), (10, 20), (160, 20))
    moved0, moved1 = move_points(pair, keypoints(xy0), keypoints(points((3, 3))), StereoMatcher())
    np.testing.assert_allclose(moved0.xy[:3], [[110, 20], [40, 20], [-10, 20]])
    assert np.isnan(moved0.xy[3]).all()
    assert moved0.known.tolist() == [True, True, True, False]
    assert moved0.visible.tolist() == [True, True, False, False]
    assert moved1.visible.tolist() == [True]
    # 160 is unknown and 10 leaves: two points count
    assert measure(pair, xy0, points((111, 20), (100, 90), (150, 90))).repeatability == 1 / 2


def test_depth_of_image_1_moves_its_points_back():
    pair = stereo(None, np.full((100, 200), 10.0))
    moved0, moved1 = move_points(pair, NO_POINTS, keypoints(points((110, 20))), StereoMatcher())
    np.testing.assert_allclose(moved1.xy, [[120, 20]])
    assert len(moved0.xy) == 0


def test_hidden_by_a_nearer_surface():
    far, near = np.full((100, 200), 10.0), np.full((100, 200), 9.0)
    point = keypoints(points((120, 20)))
    assert not move_points(stereo(far, near), point, NO_POINTS, StereoMatcher())[0].visible.any()
    assert move_points(stereo(far, 9.6 * np.ones((100, 200))), point, NO_POINTS, StereoMatcher())[0].visible.all()


def test_features_of_several_orientations_count_each():
    """Two descriptors at one place in both images are two points, found again twice."""
    xy0, xy1 = points((50, 50), (50, 50), (90, 20)), points((51, 50), (51, 50), (10, 80))
    matches = Matches(np.array([0, 1]), np.array([1, 0]))
    result = measure(shifted(0), xy0, xy1, matches)
    assert (result.repeatability, result.matching_score) == (pytest.approx(2 / 3), pytest.approx(2 / 3))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 9), st.integers(0, 9), st.integers(0, 12), st.integers(0, 1000))
def test_the_slow_twin(n0, n1, threshold, seed):
    """Mutual nearest neighbours again and again among those that are left, where nothing moves and all is seen."""
    generator = np.random.default_rng(seed)
    xy0, xy1 = generator.random((n0, 2)) * 30, generator.random((n1, 2)) * 30
    left, right, found = list(xy0), list(xy1), 0
    while left and right:
        distance = np.array([[math.dist(p, q) for q in right] for p in left])
        i, j = np.unravel_index(distance.argmin(), distance.shape)
        found += distance[i, j] <= threshold
        del left[i], right[j]
    result = measure(shifted(0), xy0, xy1, threshold=threshold)
    assert result.repeatability == pytest.approx(found / max(1, min(n0, n1)))


def test_the_larger_distance_may_be_that_in_image_0():
    half = planar([[0.5, 0, 0], [0, 0.5, 0], [0, 0, 1]])
    # 2 px apart in image 1 and 4 px in image 0
    assert measure(half, points((80, 40)), points((42, 20))).repeatability == 0
    assert measure(half, points((80, 40)), points((41, 20))).repeatability == 1


def test_matches_pick_points_of_both_images():
    xy0, xy1 = points((50, 50), (90, 20)), points((10, 80), (50, 50), (90, 20))
    right, wrong = (Matches(np.array([0, 1]), np.array(index1)) for index1 in ([1, 2], [2, 1]))
    assert measure(shifted(0), xy0, xy1, right).matching_score == 1
    assert measure(shifted(0), xy0, xy1, wrong).matching_score == 0


@pytest.mark.parametrize("sign", [1, -1])
def test_what_is_behind_the_camera_is_not_seen_though_the_map_puts_it_inside(sign):
    """The horizon of this plane is at x = 100: (120, 20) would be mapped to (150, 50), inside the image."""
    H = sign * np.array([[-1.0, 0, 90], [0, -1.0, 10], [-0.01, 0, 1]])
    given = keypoints(points((120, 20), (40, 5)))
    moved, _ = move_points(planar(H), given, NO_POINTS, StereoMatcher())
    np.testing.assert_allclose((H @ [120, 20, 1])[:2] / (H @ [120, 20, 1])[2], [150, 50])
    assert np.isnan(moved.xy[0]).all()
    assert not moved.visible[0]
    assert moved.visible[1]


def test_what_comes_behind_the_camera_is_not_seen():
    """Camera 1 is 15 m further ahead than camera 0: what was 10 m away is behind it, and on the optical axis."""
    T = np.eye(4)
    T[2, 3] = -15
    pair = stereo(np.full((100, 200), 10.0), np.full((100, 200), np.nan))
    pair = replace(pair, geometry=replace(pair.geometry, T_1_0=T))
    moved, _ = move_points(pair, keypoints(points((100, 50), (110, 55))), NO_POINTS, StereoMatcher())
    assert moved.known.all()
    assert not moved.visible.any()


def test_by_depth_each_image_has_its_own_size_and_both_focal_lengths():
    """Camera 1 is 1 m above camera 0 and has fy = 50: at 10 m a point is 5 px lower in its smaller image."""
    camera0 = Camera(np.array([[100.0, 0, 100], [0, 50, 50], [0, 0, 1]]), (200, 100))
    camera1 = Camera(camera0.matrix, (120, 60))
    T = np.eye(4)
    T[1, 3] = 1
    image1 = np.zeros((60, 120), np.uint8)
    depths = np.full((100, 200), 10.0), np.full((60, 120), 10.0)
    pair = FramePair("p", 0, 1, (IMAGE, image1), IMAGE, image1, None, ViewGeometry(T, camera0, camera1, *depths))
    xy0, xy1 = points((110, 40), (110, 53), (110, 56), (130, 40)), points((110, 45), (110, 3))
    moved0, moved1 = move_points(pair, keypoints(xy0), keypoints(xy1), StereoMatcher())
    np.testing.assert_allclose(moved0.xy, np.add(xy0, [0, 5]))
    assert moved0.visible.tolist() == [True, True, False, False]
    np.testing.assert_allclose(moved1.xy, np.subtract(xy1, [0, 5]))
    assert moved1.visible.tolist() == [True, False]


def test_the_tolerance_of_occlusion_is_that_given_in_both_directions():
    far, near = np.full((100, 200), 10.0), np.full((100, 200), 9.0)
    point = keypoints(points((120, 20)))
    for occlusion, seen in ((0.05, False), (0.2, True)):
        assert bool(move_points(stereo(far, near), point, NO_POINTS, StereoMatcher(), occlusion)[0].visible[0]) == seen
        assert bool(move_points(stereo(near, far), NO_POINTS, point, StereoMatcher(), occlusion)[1].visible[0]) == seen


def test_keypoints_may_bring_their_depth():
    """By the map a point is 10 m away and moves by 10 px; by its own depth by 20 px."""
    given = replace(keypoints(points((120, 20))), depth=np.array([5.0]))
    moved, _ = move_points(stereo(np.full((100, 200), 10.0), None), given, NO_POINTS, StereoMatcher())
    np.testing.assert_allclose(moved.xy, [[100, 20]])

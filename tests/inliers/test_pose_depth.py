from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from textured_scenes import keypoints

from sips_lit.errors import BadInputError
from sips_lit.inliers.pose_depth import PoseDepthInliers
from sips_lit.types import Camera, FramePair, Inliers, Keypoints, Matches, Reason, ViewGeometry

# Two walls that face the camera: a near one (2 m) in front of the left part of a far one (4 m). The camera moves right by
# 0.2 m with f = 100 px, so the near wall moves left by 10 px in the image and the far one by 5 px.
NEAR, FAR, F = 2.0, 4.0, 100.0
EDGE0, EDGE1 = 50, 40  # the near wall ends at this column in image 0 and in image 1
WIDTH, HEIGHT = 100, 60
CAMERA = Camera(np.array([[F, 0, 49.5], [0, F, 29.5], [0, 0, 1]]), (WIDTH, HEIGHT))
INLIER, MISSED, LOST, UNKNOWN = Reason.INLIER, Reason.FAR, Reason.LOST, Reason.UNKNOWN


def depth(edge: int) -> np.ndarray:
    columns = np.arange(WIDTH)
    return np.where(columns < edge, NEAR, FAR)[None].repeat(HEIGHT, 0).astype(np.float32)


def pair_with(depth0: np.ndarray | None, depth1: np.ndarray | None) -> FramePair:
    T_1_0 = np.eye(4)
    T_1_0[0, 3] = -0.2
    image = np.zeros((HEIGHT, WIDTH), np.uint8)
    geometry = ViewGeometry(T_1_0, CAMERA, CAMERA, depth0, depth1)
    return FramePair("walls:0-1", 0, 1, (image, image), image, image, geometry=geometry)


def judge(pair: FramePair, points0: Keypoints, points1: Keypoints, check: PoseDepthInliers | None = None) -> Inliers:
    each = np.arange(len(points0))
    inliers = (check or PoseDepthInliers())(pair, points0, points1, Matches(each, each))
    np.testing.assert_array_equal(inliers.inlier, inliers.reason == Reason.INLIER)
    return inliers


def reasons(*args: object) -> list[Reason]:
    return [Reason(r) for r in judge(*args).reason]


BOTH = pair_with(depth(EDGE0), depth(EDGE1))
# (x in image 0, x in image 1, what a match of these is): all at row 20
CASES = [
    (30, 20, INLIER),  # near wall
    (80, 75, INLIER),  # far wall
    (30, 22.9, INLIER),
    (30, 23.1, MISSED),
    (30, 25, MISSED),  # as if the near wall moved like the far one
    (5, 40, LOST),  # the near wall leaves the image on the left
    (3, 98, LOST),  # far wall at the right border of image 1 was not seen in image 0
]


@pytest.mark.parametrize(("x0", "x1", "expected"), CASES)
def test_two_walls(x0, x1, expected):
    assert reasons(BOTH, keypoints([[x0, 20]]), keypoints([[x1, 20]])) == [expected]


@pytest.mark.parametrize(("x0", "x1", "expected"), CASES[:5])
@pytest.mark.parametrize("lacking", [0, 1])
def test_one_depth_decides_alone(x0, x1, expected, lacking):
    pair = pair_with(None if lacking == 0 else depth(EDGE0), None if lacking == 1 else depth(EDGE1))
    inliers = judge(pair, keypoints([[x0, 20], [50, 50]]), keypoints([[x1, 20], [45, 50]]))
    assert inliers.reason[0] == expected
    # a point without a depth of its own is known through its match
    assert (inliers.known0 if lacking == 0 else inliers.known1).tolist()[0]


def test_points_that_the_near_wall_hides_are_lost():
    # Columns 40 to 45 of the far wall, seen in image 1, are behind the near wall in image 0.
    hidden = keypoints([[47, 20]]), keypoints([[42, 20]])
    assert reasons(pair_with(None, depth(EDGE1)), *hidden) == [INLIER]  # nobody knows what hides it in image 0
    assert reasons(BOTH, *hidden) == [MISSED]  # what is seen in image 0 is the near wall, and it goes elsewhere
    holes = depth(EDGE0)
    holes[:, 48] = np.nan  # the way back alone decides where image 0 has no depth at the point itself ...
    assert reasons(pair_with(holes, depth(EDGE1)), keypoints([[48.4, 20]]), keypoints([[42, 20]])) == [LOST]
    holes[:, 47] = np.nan  # ... and can't know what hides it where there is none either
    assert reasons(pair_with(holes, depth(EDGE1)), *hidden) == [INLIER]


def test_where_both_depths_are_known_both_must_agree():
    front = depth(EDGE1)
    front[:, 77] = 1  # something thin and close that only image 1 shows
    args = keypoints([[80, 20]]), keypoints([[77, 20]])
    assert reasons(BOTH, *args) == [INLIER]
    assert reasons(pair_with(depth(EDGE0), front), *args) == [MISSED]


def test_occlusion_is_relative():
    front, behind = depth(0), depth(0)
    front[:] = FAR * 0.97
    args = keypoints([[60, 20]]), keypoints([[55, 20]])
    assert reasons(pair_with(behind, front), *args) == [INLIER]
    assert reasons(pair_with(behind, front), *args, PoseDepthInliers(occlusion=0.01)) == [LOST]


@pytest.mark.parametrize(("relative", "expected"), [(0.96, INLIER), (0.94, LOST)])
def test_five_percent_of_occlusion_by_default(relative, expected):
    pair = pair_with(depth(0), np.full((HEIGHT, WIDTH), FAR * relative, np.float32))
    assert reasons(pair, keypoints([[60, 20]]), keypoints([[55, 20]])) == [expected]


def test_matches_pick_points_and_their_depths():
    """The first point of image 0, on the near wall, is the second one of image 1, and the other way round."""
    points0, points1 = keypoints([[30, 20], [80, 20]]), keypoints([[75, 20], [20, 20]])
    inliers = PoseDepthInliers()(BOTH, points0, points1, Matches(np.array([0, 1]), np.array([1, 0])))
    assert inliers.inlier.tolist() == [True, True]


def other_view(size1: tuple[int, int], shift: float = 0.0) -> FramePair:
    """Cameras of equal focal length at one place; image 1 has another size, and its pixels are ``shift`` to the right.

    All numbers are multiples of powers of two, so that nothing is rounded. The world is 2 m away.
    """
    cameras = [
        Camera(np.array([[128.0, 0, c], [0, 128.0, 0], [0, 0, 1]]), s) for c, s in ((0, (100, 60)), (shift, size1))
    ]
    images = tuple(np.zeros(camera.size[::-1], np.uint8) for camera in cameras)
    depths = [np.full(image.shape, 2, np.float32) for image in images]
    return FramePair("a", 0, 1, images, *images, geometry=ViewGeometry(np.eye(4), *cameras, *depths))


@pytest.mark.parametrize(("x1", "expected"), [(67, INLIER), (61, INLIER), (68, MISSED)])
def test_exactly_three_pixels_are_within_the_threshold(x1, expected):
    assert reasons(other_view((200, 60), 32.0), keypoints([[32, 20]]), keypoints([[x1, 20]])) == [expected]


@pytest.mark.parametrize(("width", "expected"), [(200, MISSED), (64, LOST)])
def test_the_border_is_that_of_the_other_image(width, expected):
    # the point is at x = 112 there
    assert reasons(other_view((width, 60), 32.0), keypoints([[80, 20]]), keypoints([[10, 20]])) == [expected]


@pytest.mark.parametrize(("shift", "expected"), [(-32.375, MISSED), (-32.75, LOST), (67.375, MISSED), (67.75, LOST)])
def test_pixels_reach_half_a_pixel_beyond_their_centres(shift, expected):
    # the point at x = 32 moves by the shift: to 0.375 or 0.75 px beyond the first or the last column, 99
    assert reasons(other_view((100, 60), shift), keypoints([[32, 20]]), keypoints([[50, 20]])) == [expected]


def test_unknown_depth():
    holes0, holes1 = depth(EDGE0), depth(EDGE1)
    holes0[:, 30], holes0[:, 31], holes1[:, 75] = np.nan, 0, -1
    points0, points1 = (
        keypoints([[30, 20], [31, 20], [80, 20], [90, 20]]),
        keypoints([[20, 20], [21, 20], [75, 20], [75, 20]]),
    )
    # with a hole in one image the other decides
    inliers = judge(pair_with(holes0, holes1), points0, points1)
    assert inliers.reason.tolist() == [INLIER, INLIER, INLIER, MISSED]
    assert inliers.known0.all()
    assert inliers.known1.all()
    # with holes in both nothing is known
    inliers = judge(pair_with(holes0, holes1), keypoints([[30, 20], [80, 20]]), keypoints([[75, 20], [75, 20]]))
    assert inliers.reason.tolist() == [UNKNOWN, INLIER]
    assert inliers.known0.tolist() == [False, True]
    assert inliers.known1.tolist() == [False, True]


def test_unmatched_points_are_known_by_their_own_depth():
    holes = depth(EDGE0)
    holes[:, 30] = np.nan
    points0, points1 = keypoints([[30, 20], [60, 20]]), keypoints([[10, 10]])
    none = np.zeros(0, np.int64)
    inliers = PoseDepthInliers()(pair_with(holes, None), points0, points1, Matches(none, none))
    assert inliers.known0.tolist() == [False, True]
    assert inliers.known1.tolist() == [False]
    assert len(inliers.reason) == 0


def test_swapping_the_images_changes_nothing():
    generator = np.random.default_rng(0)
    xy0 = generator.uniform([0, 0], [WIDTH - 1, HEIGHT - 1], (300, 2))
    xy1 = xy0 - np.where(generator.random(300) < 0.5, 5.0, 10.0)[:, None] * [1, 0]
    swapped = ViewGeometry(np.linalg.inv(BOTH.geometry.T_1_0), CAMERA, CAMERA, depth(EDGE1), depth(EDGE0))
    turned = FramePair("walls:1-0", 1, 0, BOTH.frames, BOTH.image1, BOTH.image0, geometry=swapped)
    forth, back = judge(BOTH, keypoints(xy0), keypoints(xy1)), judge(turned, keypoints(xy1), keypoints(xy0))
    np.testing.assert_array_equal(forth.inlier, back.inlier)
    assert 50 < forth.inlier.sum() < 250


def test_points_that_come_behind_the_camera_are_lost():
    T_1_0 = np.eye(4)
    T_1_0[2, 3] = -3  # forward through the near wall
    image = np.zeros((HEIGHT, WIDTH), np.uint8)
    geometry = ViewGeometry(T_1_0, CAMERA, CAMERA, depth(EDGE0), None)
    pair = FramePair("walls:0-1", 0, 1, (image, image), image, image, geometry=geometry)
    assert reasons(pair, keypoints([[30, 20]]), keypoints([[30, 20]])) == [LOST]


def test_no_points():
    assert reasons(BOTH, Keypoints.empty(), Keypoints.empty()) == []


def test_a_pair_without_geometry():
    image = np.zeros((9, 9), np.uint8)
    pair = FramePair("clip:3-4", 3, 4, (image, image), image, image)
    with pytest.raises(BadInputError, match="clip:3-4 has no pose, camera and depth: choose another source"):
        judge(pair, keypoints([[1, 1]]), keypoints([[1, 1]]))


def test_protocol():
    protocol = dict(PoseDepthInliers().protocol)
    assert protocol.pop("stereo")["max_disparity"] == 192
    assert protocol == {"inliers": "pose_depth", "threshold": 3.0, "occlusion": 0.05}
    other = PoseDepthInliers(threshold=2.0, occlusion=0.1).protocol
    assert (other["threshold"], other["occlusion"]) == (2.0, 0.1)
    assert PoseDepthInliers.independent
    assert not PoseDepthInliers.uses_frames


@pytest.mark.parametrize(("y1", "expected"), [(35, INLIER), (30, MISSED), (40, MISSED)])
def test_the_vertical_focal_length(y1, expected):
    """fx = 100, fy = 50: a camera that goes 0.2 m up sees what is 2 m away 5 px lower, wherever in the image it is."""
    camera, T = Camera(np.array([[100.0, 0, 49.5], [0, 50, 29.5], [0, 0, 1]]), (WIDTH, HEIGHT)), np.eye(4)
    T[1, 3] = 0.2
    wall = np.full((HEIGHT, WIDTH), NEAR, np.float32)
    pair = replace(BOTH, geometry=ViewGeometry(T, camera, camera, wall, wall))
    for rest in (0, 20):
        assert reasons(pair, keypoints([[80, 30 + rest]]), keypoints([[80, y1 + rest]])) == [expected]


class Constant:
    """A stereo matcher that sees everything at one disparity."""

    parameters = MappingProxyType({"of": "a test"})

    def __init__(self, disparity: float) -> None:
        self.value = disparity

    def disparity(self, image, partner, xy, to_the_right=True):
        return np.full(len(xy), self.value)


@pytest.mark.parametrize("partner", ["right0", "right1"])
@pytest.mark.parametrize(("disparity", "expected"), [(10, INLIER), (5, MISSED)])
def test_the_matcher_that_is_given_tells_the_depth(partner, disparity, expected):
    """With a baseline of 0.2 m, as the motion has, points move by their disparity."""
    pair = pair_with(None, None)
    pair = replace(pair, geometry=replace(pair.geometry, baseline=0.2, **{partner: pair.image0}))
    check = PoseDepthInliers(stereo=Constant(disparity))
    assert reasons(pair, keypoints([[30, 20]]), keypoints([[20, 20]]), check) == [expected]
    assert check.protocol["stereo"] == {"of": "a test"}


def test_residuals_lead_from_the_matched_point_to_where_the_point_moves():
    """The far wall moves 5 px to the left; a depth that is not known leaves its direction unknown."""
    inliers = judge(pair_with(depth(EDGE0), None), keypoints([[80, 20]]), keypoints([[74, 22]]))
    np.testing.assert_allclose(inliers.residual[0, 0], [1, -2], atol=1e-4)
    assert np.isnan(inliers.residual[0, 1]).all()
    back = judge(BOTH, keypoints([[80, 20]]), keypoints([[74, 22]])).residual[0, 1]
    np.testing.assert_allclose(back, [-1, 2], atol=1e-4)

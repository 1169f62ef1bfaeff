import numpy as np
import pytest
from textured_scenes import keypoints

from sips_lit.errors import BadInputError
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.types import FramePair, Keypoints, Matches, Reason

IMAGE = np.zeros((120, 160), np.uint8)


def pair_with(H: object) -> FramePair:
    return FramePair("wall:1-2", 0, 1, (IMAGE, IMAGE), IMAGE, IMAGE, None if H is None else np.array(H, float))


def judge(H: object, points0: Keypoints, points1: Keypoints, threshold: float = 3.0) -> list[Reason]:
    each = np.arange(len(points0))
    inliers = HomographyInliers(threshold)(pair_with(H), points0, points1, Matches(each, each))
    np.testing.assert_array_equal(inliers.inlier, inliers.reason == Reason.INLIER)
    assert inliers.known0.all()
    assert inliers.known1.all()
    return [Reason(r) for r in inliers.reason]


SHIFT = [[1, 0, 10], [0, 1, -5], [0, 0, 1]]


def test_each_reason():
    start = keypoints([[50, 50], [50, 50], [50, 50], [155, 50]])
    goal = keypoints([[60, 45], [60, 47.9], [64, 45], [100, 45]])
    assert judge(SHIFT, start, goal) == [Reason.INLIER, Reason.INLIER, Reason.FAR, Reason.LOST]


@pytest.mark.parametrize(("off", "expected"), [(2.999, Reason.INLIER), (3.001, Reason.FAR)])
def test_the_threshold_of_three_pixels(off, expected):
    for x, y in ((off, 0), (0, -off), (off * 0.6, off * 0.8)):
        assert judge(SHIFT, keypoints([[50, 50]]), keypoints([[60 + x, 45 + y]])) == [expected]


def test_exactly_three_pixels_are_within_the_default_threshold():
    each = np.arange(4)
    goal = keypoints([[63, 45], [60, 42], [64, 45], [60, 49]])
    inliers = HomographyInliers()(pair_with(SHIFT), keypoints([[50, 50]] * 4), goal, Matches(each, each))
    assert inliers.inlier.tolist() == [True, True, False, False]


def test_the_point_may_lie_anywhere_in_the_other_image():
    small, large = np.zeros((60, 80), np.uint8), np.zeros((240, 320), np.uint8)
    for image0, image1, expected in ((small, large, Reason.FAR), (large, small, Reason.LOST)):
        pair = FramePair("a", 0, 1, (image0, image1), image0, image1, np.diag([4.0, 4, 1]))
        one = Matches(np.array([0]), np.array([0]))
        inliers = HomographyInliers()(pair, keypoints([[50, 40]]), keypoints([[5, 5]]), one)  # it is at (200, 160)
        assert inliers.reason.tolist() == [expected]


@pytest.mark.parametrize(
    ("scale", "off", "expected"), [(2, 2.5, Reason.INLIER), (2, 4.0, Reason.FAR), (0.5, 2.5, Reason.FAR)]
)
def test_the_threshold_holds_in_both_images(scale, off, expected):
    # 4 pixels in an image of twice the size are only 2 in the other; 2.5 in one of half the size are 5 in the other
    assert judge(np.diag([scale, scale, 1]), keypoints([[40, 30]]), keypoints([[40 * scale + off, 30 * scale]])) == [
        expected
    ]


def test_larger_points_may_be_further():
    def reason(scale0: float, scale1: float) -> Reason:
        return judge(np.eye(3), keypoints([[40, 30]], scale=scale0), keypoints([[44, 30]], scale=scale1))[0]

    assert reason(2, 2) == Reason.INLIER
    assert reason(1, 2) == reason(2, 1) == reason(1, 1) == Reason.FAR


@pytest.mark.parametrize(("x", "expected"), [(149.4, Reason.FAR), (149.6, Reason.LOST)])
def test_lost_where_the_other_image_ends(x, expected):
    assert judge(SHIFT, keypoints([[x, 50]]), keypoints([[20, 20]])) == [expected]


def test_points_behind_the_camera_are_lost():
    H = [[1, 0, 0], [0, 1, 0], [-0.01, 0, 1]]  # the horizon is at x = 100
    start, goal = keypoints([[50, 40], [120, 40], [100, 40]]), keypoints([[100, 80], [-600, -200], [50, 50]])
    for sign in (1, -1):  # a homography has no sign of its own
        assert judge(sign * np.array(H), start, goal) == [Reason.INLIER, Reason.LOST, Reason.LOST]


def test_known_homography_of_a_sequence(short_flight):
    H = short_flight.homography(0, 11)
    start = np.random.default_rng(0).uniform([30, 30], [130, 90], (40, 2))
    goal = np.array([[*(H @ [x, y, 1])[:2]] for x, y in start]) / 1.0  # affine: the third coordinate is 1
    assert judge(H, keypoints(start), keypoints(goal)) == [Reason.INLIER] * 40
    assert Reason.INLIER not in judge(H, keypoints(start), keypoints(np.add(goal, [3.2, 0])))


def test_matches_pick_points():
    points0, points1 = keypoints([[9, 9], [50, 50]]), keypoints([[60, 45], [1, 1], [2, 2]])
    inliers = HomographyInliers()(pair_with(SHIFT), points0, points1, Matches(np.array([1]), np.array([0])))
    assert inliers.inlier.tolist() == [True]
    assert (len(inliers.known0), len(inliers.known1)) == (2, 3)


def test_no_matches():
    assert judge(SHIFT, Keypoints.empty(), Keypoints.empty()) == []


def test_a_pair_without_homography():
    with pytest.raises(BadInputError, match="wall:1-2 has no homography: choose another source of inliers"):
        judge(None, keypoints([[1, 1]]), keypoints([[1, 1]]))


def test_protocol():
    assert dict(HomographyInliers(2).protocol) == {"inliers": "homography", "threshold": 2}
    assert HomographyInliers.independent
    assert not HomographyInliers.uses_frames

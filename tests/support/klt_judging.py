import numpy as np
from textured_scenes import keypoints

from sips_lit.inliers.klt import KltInliers
from sips_lit.types import FramePair, Matches, Reason


def match(index0: list[int], index1: list[int]) -> Matches:
    return Matches(np.array(index0, np.int64), np.array(index1, np.int64))


def judge(check: KltInliers, pair: FramePair, xy0: object, xy1: object) -> list[Reason]:
    """What a check says of points that match in their order."""
    points0, points1 = keypoints(xy0), keypoints(xy1)
    everything = list(range(len(points0)))
    inliers = check(pair, points0, points1, match(everything, everything))
    np.testing.assert_array_equal(inliers.inlier, inliers.reason == Reason.INLIER)
    return [Reason(r) for r in inliers.reason]

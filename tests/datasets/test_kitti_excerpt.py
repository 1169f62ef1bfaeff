"""The published pixels agree with the geometry that the loader tells of them."""

import numpy as np
import pytest
from sift_matches import sift_matches

from sips_lit.datasets.kitti import kitti
from sips_lit.geometry.projection import transfer

pytestmark = pytest.mark.shared_data


@pytest.mark.parametrize("max_side", [None, 800])
def test_stereo_rows_and_sides(shared_data, max_side):
    (sequence,) = kitti(shared_data / "kitti_odometry", max_side=max_side)
    for index in (10, 40):
        left, right = sift_matches(sequence.frame(index), sequence.right(index))
        assert len(left) > 100
        assert np.median(np.abs(left[:, 1] - right[:, 1])) < 0.5  # 0.3 to 0.6 in this sequence
        assert np.mean(left[:, 0] - right[:, 0] > -1) > 0.9


def test_poses_and_stereo_depth_predict_the_next_frame(shared_data):
    (sequence,) = kitti(shared_data / "kitti_odometry", max_side=900)
    camera, T_1_0 = sequence.camera(0), np.linalg.inv(sequence.pose(11)) @ sequence.pose(10)
    left, right = sift_matches(sequence.frame(10), sequence.right(10))
    next_of = {
        tuple(start): end for start, end in zip(*sift_matches(sequence.frame(10), sequence.frame(11)), strict=True)
    }
    disparity = left[:, 0] - right[:, 0]
    usable = [tuple(x) in next_of and d > 2 for x, d in zip(left, disparity, strict=True)]
    start, goal = left[usable], np.array([next_of[tuple(x)] for x in left[usable]])
    depth = camera.matrix[0, 0] * sequence.baseline() / disparity[usable]

    def error(T: np.ndarray) -> float:
        return float(np.median(np.linalg.norm(transfer(start, depth, camera, camera, T)[0] - goal, axis=1)))

    assert len(start) > 100
    assert error(T_1_0) < 0.6
    assert min(error(np.eye(4)), error(np.linalg.inv(T_1_0))) > 10

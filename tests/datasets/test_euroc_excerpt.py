"""The published pictures agree with the calibration that the loader applies."""

import numpy as np
import pytest
from sift_matches import sift_matches

from sips_lit.datasets.euroc import euroc
from sips_lit.frames.images import read_grey

pytestmark = pytest.mark.shared_data


@pytest.mark.parametrize("max_side", [None, 600])
def test_rows_of_left_and_right_are_aligned(shared_data, max_side):
    (sequence,) = euroc(shared_data / "euroc_v1_01_excerpt", max_side=max_side)
    assert len(sequence) == 19
    offsets, stored_offsets = [], []
    for index in (0, 9, 18):
        left, right = sift_matches(sequence.frame(index), sequence.right(index))
        assert len(left) > 100
        offsets.append(np.abs(left[:, 1] - right[:, 1]))
        assert np.mean(left[:, 0] - right[:, 0] > -0.5) > 0.95
        name = sequence.frame_name(index).rsplit("_", 1)[1] + ".png"
        stored = [shared_data / "euroc_v1_01_excerpt/mav0" / camera / "data" / name for camera in ("cam0", "cam1")]
        left, right = sift_matches(*map(read_grey, stored))
        stored_offsets.append(np.abs(left[:, 1] - right[:, 1]))
    assert np.median(np.concatenate(offsets)) < 0.5
    assert np.median(np.concatenate(offsets)) < np.median(np.concatenate(stored_offsets)) / 10


def test_the_drone_stands_still_in_its_room(shared_data):
    (sequence,) = euroc(shared_data / "euroc_v1_01_excerpt/mav0")
    poses = np.stack([sequence.pose(i) for i in range(len(sequence))])
    places = poses[:, :3, 3]
    assert np.linalg.norm(places - places[0], axis=1).max() < 0.2
    assert (poses[:, 2, 1] < -0.9).all()  # the image's y axis points to the floor: gravity is along -z
    left, right = sift_matches(sequence.frame(0), sequence.right(0))
    disparity = left[:, 0] - right[:, 0]
    depth = sequence.camera(0).matrix[0, 0] * sequence.baseline() / disparity[disparity > 1]
    assert 0.5 < np.median(depth) < 8  # metres: the room is about 8 m x 8 m

import cv2
import numpy as np
import pytest
from seen_points import pose

from sips_lit.datasets.layout import read_pose_rows
from sips_lit.errors import BadInputError
from sips_lit.odometry.files import write_kitti, write_tum

POSES = np.stack([pose(7 * i) for i in range(5)])
TIMES = [1305031102.1753 + 0.1 * i for i in range(5)]


def test_other_tools_read_the_same_poses(tmp_path):
    pytest.importorskip("evo", reason="the reader of other tools is in the extra test")
    from evo.tools import file_interface

    write_tum(tmp_path / "a.tum", TIMES, POSES)
    write_kitti(tmp_path / "a.kitti", POSES)
    tum = file_interface.read_tum_trajectory_file(tmp_path / "a.tum")
    np.testing.assert_allclose(tum.poses_se3, POSES, atol=1e-8)
    np.testing.assert_allclose(tum.timestamps, TIMES, atol=1e-6)
    np.testing.assert_allclose(file_interface.read_kitti_poses_file(tmp_path / "a.kitti").poses_se3, POSES, atol=1e-8)


def test_the_columns_are_those_of_the_formats(tmp_path):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(np.array([0, 0, np.pi / 2]))[0], (1, 2, 3)
    write_tum(tmp_path / "sub" / "a.tum", [9.5], T[None])
    write_kitti(tmp_path / "sub" / "a.kitti", T[None])
    half = np.sqrt(0.5)
    np.testing.assert_allclose(np.loadtxt(tmp_path / "sub" / "a.tum"), [9.5, 1, 2, 3, 0, 0, half, half], atol=1e-8)
    np.testing.assert_allclose(
        np.loadtxt(tmp_path / "sub" / "a.kitti"), [0, -1, 0, 1, 1, 0, 0, 2, 0, 0, 1, 3], atol=1e-8
    )


def test_our_own_reader_takes_them(tmp_path):
    write_kitti(tmp_path / "poses.txt", POSES)
    np.testing.assert_allclose(read_pose_rows(tmp_path / "poses.txt"), POSES, atol=1e-8)


def test_a_place_that_can_not_be_written_is_told(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(BadInputError, match="cannot make the folder"):
        write_kitti(tmp_path / "file" / "a.kitti", POSES)

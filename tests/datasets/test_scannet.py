import numpy as np
import pytest
from rgbd_files import depth_of, pose, render, write_image
from rgbd_layouts import SCANNET_K, SCANNET_SIZE, SIZE, K, write_pose, write_scannet

from sips_lit.datasets.scannet import scannet
from sips_lit.errors import BadInputError, InputWarning


@pytest.mark.parametrize("max_side", [None, 96])
def test_depth_of_another_size(tmp_path, max_side):
    (sequence,) = scannet(write_scannet(tmp_path / "scene0000_00"), max_side=max_side)
    assert (sequence.name, len(sequence)) == ("scene0000_00", 4)
    height, width = sequence.frame(1).shape
    assert sequence.camera(1).size == (width, height)
    xy = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 2)
    for i in range(4):
        np.testing.assert_allclose(sequence.pose(i), pose(i))
        depth = sequence.depth(i).ravel()
        known = np.isfinite(depth)
        assert known.mean() > 0.9
        error = depth[known] - depth_of(xy, pose(i), sequence.camera(i).matrix)[0][known]
        assert np.abs(error).max() < 1e-2  # half a pixel of the smaller map
        assert abs(error.mean()) < 1e-3  # to no side
    if max_side is None:
        np.testing.assert_array_equal(sequence.camera(0).matrix, K)
        assert np.abs(sequence.frame(2).astype(float) - render(2, K, SIZE)[0]).mean() < 4  # a JPEG


def test_where_tracking_was_lost(tmp_path):
    folder = write_scannet(tmp_path)
    write_pose(folder / "pose" / "1.txt", np.full((4, 4), -np.inf))
    with pytest.warns(InputWarning, match="0 have no depth map and 1 no pose"):
        (sequence,) = scannet(folder)
    assert [sequence.pose(i) is None for i in range(4)] == [False, True, False, False]
    with pytest.warns(InputWarning, match="left out"):
        (kept,) = scannet(folder, drop_incomplete=True)
    assert [file.name for file in kept.files] == ["0.jpg", "2.jpg", "3.jpg"]


def test_images_shrunk_to_the_depth(tmp_path):
    folder = write_scannet(tmp_path)
    for i in range(4):
        write_image(folder / "color" / f"{i}.jpg", render(i, SCANNET_K, SCANNET_SIZE)[0])
    (sequence,) = scannet(folder)
    np.testing.assert_array_equal(sequence.camera(0).matrix, SCANNET_K)
    for i in range(4):  # to another size: no matrix is of these
        write_image(folder / "color" / f"{i}.jpg", np.zeros((60, 80), np.uint8))
    with pytest.raises(BadInputError, match=r"intrinsic_color\.txt is not of images of 80x60"):
        scannet(folder)


def test_numbers_of_ten_come_after_those_of_one(tmp_path):
    (sequence,) = scannet(write_scannet(tmp_path, 11))
    assert [file.stem for file in sequence.files] == [str(i) for i in range(11)]
    np.testing.assert_allclose(sequence.pose(10), pose(10))


def test_the_other_names_of_intrinsics(tmp_path):
    folder = write_scannet(tmp_path / "scans" / "scene", 2)
    for name in ("color", "depth"):
        (folder / "intrinsic" / f"intrinsic_{name}.txt").rename(folder / f"intrinsics_{name}.txt")
    assert [s.name for s in scannet(tmp_path / "scans")] == ["scans_scene"]
    (folder / "intrinsics_depth.txt").write_text("1 0 0\n0 1 0\n")
    with pytest.raises(BadInputError, match=r"intrinsics_depth\.txt has no camera matrix"):
        scannet(folder)
    (folder / "intrinsics_depth.txt").unlink()
    with pytest.raises(BadInputError, match=r"there is no .*intrinsic_depth\.txt"):
        scannet(folder)
    with pytest.raises(BadInputError, match="no export of ScanNet at"):
        scannet(folder / "color")

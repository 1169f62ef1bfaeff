import warnings
from dataclasses import replace

import pytest
from rgbd_files import write_simple

from sips_lit.datasets.rgbd import read_simple
from sips_lit.datasets.rgbd_folders import rgbd_sequence, sequence_folders
from sips_lit.errors import BadInputError, InputWarning
from sips_lit.types import Camera


def is_sequence(folder):
    return (folder / "mark").exists()


@pytest.fixture
def root(tmp_path):
    for name in ("b/2", "b/1", "a", ".hidden", "c/d/e"):
        (tmp_path / "root" / name).mkdir(parents=True)
        (tmp_path / "root" / name / "mark").touch()
    return tmp_path / "root"


@pytest.mark.parametrize(
    ("place", "levels", "names"),
    [(".", 1, ["root_a"]), (".", 2, ["root_a", "root_b_1", "root_b_2"]), ("b", 1, ["b_1", "b_2"]), ("a", 2, ["a"])],
)
def test_folders_of_sequences(root, place, levels, names):
    found = sequence_folders(root / place, is_sequence, "walk", "a walk has a mark", levels)
    assert list(found) == names
    assert all(is_sequence(folder) for folder in found.values())


@pytest.mark.parametrize("place", ["c", "a/mark", "gone"])
def test_none(root, place):
    with pytest.raises(BadInputError, match=rf"there is no walk at .*{place}: .*; a walk has a mark"):
        sequence_folders(root / place, is_sequence, "walk", "a walk has a mark")


def test_frames_without_depth_or_pose(tmp_path):
    whole = read_simple(write_simple(tmp_path, 4))
    cameras = [Camera(whole.camera.matrix + i, whole.camera.size) for i in range(4)]
    frames = replace(whole, depths=[None, *whole.depths[1:]], poses=[*whole.poses[:3], None], cameras=cameras)
    with pytest.warns(InputWarning, match="of 4 images of .* 1 have no depth map and 1 no pose"):
        sequence = rgbd_sequence("desk", tmp_path, frames, None)
    assert (sequence.name, len(sequence)) == ("desk", 4)
    with pytest.warns(InputWarning, match="left out"):
        kept = rgbd_sequence("desk", tmp_path, frames, None, drop_incomplete=True)
    assert [file.stem[-1] for file in kept.files] == ["1", "2"]
    assert [kept.camera(i).matrix[0, 0] for i in range(2)] == [151, 152]
    frames = replace(whole, depths=[None] * 4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a data set without depth lacks nothing
        rgbd_sequence("desk", tmp_path, frames, None)
    with pytest.warns(InputWarning), pytest.raises(BadInputError, match="only 0 images"):
        rgbd_sequence("desk", tmp_path, frames, None, drop_incomplete=True)
    with pytest.raises(BadInputError, match="max_side"):
        rgbd_sequence("desk", tmp_path, whole, 3)

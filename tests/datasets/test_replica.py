import json

import numpy as np
import pytest
from rgbd_files import pose, render
from rgbd_layouts import SIZE, K, write_replica

from sips_lit.datasets.replica import replica
from sips_lit.errors import BadInputError, InputWarning


@pytest.mark.parametrize("beside", [False, True])
def test_colour_depth_and_poses(tmp_path, beside):
    (sequence,) = replica(write_replica(tmp_path / "room0", beside=beside))
    assert (sequence.name, len(sequence)) == ("room0", 4)
    np.testing.assert_array_equal(sequence.camera(1).matrix, K)
    for i in range(4):
        image, depth = render(i, K, SIZE)
        assert np.abs(sequence.frame(i).astype(float) - image).mean() < 4  # a JPEG
        np.testing.assert_allclose(sequence.pose(i), pose(i))
        known = np.isfinite(sequence.depth(i))
        assert (~known).sum() == 20
        np.testing.assert_allclose(sequence.depth(i)[known], depth[known], atol=1e-4)


def test_rows_belong_to_numbers(tmp_path):
    folder = write_replica(tmp_path / "room0")
    (folder / "results" / "frame000001.jpg").unlink()
    (folder / "results" / "depth000002.png").unlink()
    with pytest.warns(InputWarning, match="1 have no depth map and 0 no pose"):
        (sequence,) = replica(folder)
    for i, number in enumerate((0, 2, 3)):
        np.testing.assert_allclose(sequence.pose(i), pose(number))
    assert [sequence.depth(i) is None for i in range(3)] == [False, True, False]
    (folder / "traj.txt").write_text("\n".join((folder / "traj.txt").read_text().splitlines()[:3]))
    with pytest.raises(BadInputError, match=r"traj\.txt has 3 rows, too few for .*frame000003"):
        replica(folder)


def test_a_folder_of_scenes(tmp_path):
    for name in ("room0", "office1"):
        write_replica(tmp_path / "Replica" / name, 2)
    assert [s.name for s in replica(tmp_path / "Replica")] == ["Replica_office1", "Replica_room0"]
    with pytest.raises(BadInputError, match="no scene of Replica at"):
        replica(tmp_path / "Replica" / "room0" / "results")


@pytest.mark.parametrize(
    "wrong",
    [
        {"scale": 0},
        {"fx": -1},
        {"w": "wide"},
        {"cx": float("inf")},
        {"fy": None},
        [],
        {"w": 0},
        {"fx": 1e300},
        {"scale": 1e-300},
    ],
)
def test_cameras_that_are_none(tmp_path, wrong):
    file = write_replica(tmp_path / "room0", 2).parent / "cam_params.json"
    camera = json.loads(file.read_text())["camera"]
    file.write_text(json.dumps({"camera": camera | wrong if isinstance(wrong, dict) else wrong}))
    with pytest.raises(BadInputError, match=r"cam_params\.json (has|holds) "):
        replica(tmp_path / "room0")


def test_missing_and_broken_files(tmp_path):
    folder = write_replica(tmp_path / "room0", 2)
    (tmp_path / "cam_params.json").rename(tmp_path / "camera.json")
    with pytest.raises(BadInputError, match=r"there is no .*cam_params\.json"):
        replica(folder)
    (tmp_path / "camera.json").rename(tmp_path / "cam_params.json")
    rows = (folder / "traj.txt").read_text().splitlines()
    (folder / "traj.txt").write_text("\n".join([rows[0], " ".join(["2"] * 16)]))
    with pytest.raises(BadInputError, match=r"line 2 of .*traj\.txt is no pose"):
        replica(folder)

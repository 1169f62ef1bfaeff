import json

import cv2
import numpy as np
import pytest
from rgbd_files import depth_of, pose, render, write_image
from rgbd_layouts import SIZE, K, change, write_nerfstudio

from sips_lit.datasets.nerfstudio import nerfstudio
from sips_lit.errors import BadInputError, InputWarning

LENS = {"k1": -0.12, "k2": 0.03, "p1": 0.001, "p2": -0.002}


def test_images_cameras_poses_and_depth(tmp_path):
    (sequence,) = nerfstudio(write_nerfstudio(tmp_path / "desk"))
    assert (sequence.name, len(sequence), sequence.frame_name(0)) == ("desk", 4, "desk_frame_00001")
    for i in range(4):
        image, depth = render(i, K, SIZE)
        np.testing.assert_array_equal(sequence.frame(i), image)  # not a smaller copy, not a mask
        np.testing.assert_allclose(sequence.camera(i).matrix, K)
        np.testing.assert_allclose(sequence.pose(i), pose(i), atol=1e-12)  # OpenGL's axes are turned
        np.testing.assert_allclose(sequence.depth(i), depth, atol=6e-4)


@pytest.mark.parametrize("smaller", [False, True])
def test_a_lens_is_undistorted_and_with_it_the_depth(tmp_path, smaller):
    folder = write_nerfstudio(tmp_path, 2, LENS)
    if smaller:
        for file in (folder / "depths").iterdir():
            stored = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
            write_image(file, cv2.resize(stored, (80, 60), interpolation=cv2.INTER_AREA))
    (sequence,) = nerfstudio(folder)
    camera = sequence.camera(1)
    image, depth = render(1, camera.matrix, camera.size)
    seen = sequence.frame(1).astype(float)
    assert np.abs(seen - image).mean() < 0.25 * np.abs(np.roll(seen, 1, 1) - image).mean()  # not a pixel off
    known = np.isfinite(sequence.depth(1))
    assert known.mean() > 0.97
    np.testing.assert_allclose(sequence.depth(1)[known], depth[known], atol=8e-3)
    bent = render(1, K, SIZE, [*LENS.values(), 0])[0]
    assert np.abs(bent.astype(float) - render(1, K, SIZE)[0]).mean() > 6  # the test can tell


def test_an_equidistant_lens(tmp_path):
    lens = {"camera_model": "OPENCV_FISHEYE", "k1": 0.02, "k2": -0.01, "k3": 0.003, "k4": -0.001}
    folder = write_nerfstudio(tmp_path, 2, depth=False)
    change(folder / "transforms.json", **lens)
    wide = (400, 300)
    whole_K = np.array([[150.0, 0, 201], [0, 150.0, 149], [0, 0, 1]])
    whole = render(0, whole_K, wide)[0]
    # a pixel of the lens by the direction that it sees, in a larger picture by a pinhole camera
    xy = np.stack(np.meshgrid(np.arange(160.0), np.arange(120.0)), -1).reshape(-1, 1, 2)
    rays = cv2.fisheye.undistortPoints(xy, K, np.array([lens[f"k{i}"] for i in range(1, 5)]))[:, 0]
    at = (rays @ whole_K[:2, :2] + whole_K[:2, 2]).reshape(120, 160, 2).astype(np.float32)
    write_image(folder / "images" / "frame_00001.png", cv2.remap(whole, at[..., 0], at[..., 1], cv2.INTER_LINEAR))
    (sequence,) = nerfstudio(folder)
    camera = sequence.camera(0)
    expected = render(0, camera.matrix, camera.size)[0]
    inner = np.s_[15:-15, 15:-15]
    seen = sequence.frame(0).astype(float)
    for off in (np.roll(seen, 1, 0), np.roll(seen, 1, 1), render(0, K, SIZE)[0].astype(float)):
        assert np.abs(seen - expected)[inner].mean() < 0.5 * np.abs(off - expected)[inner].mean()


def test_a_camera_for_each_frame(tmp_path):
    folder = write_nerfstudio(tmp_path)
    stored = json.loads((folder / "transforms.json").read_text())
    for i, frame in enumerate(stored["frames"]):  # in no order
        frame["fl_x"] = 150.0 + i
    change(folder / "transforms.json", frames=stored["frames"])
    (sequence,) = nerfstudio(folder)
    assert [sequence.camera(i).matrix[0, 0] for i in range(4)] == [153, 152, 151, 150]
    (small,) = nerfstudio(folder, max_side=80)
    assert [small.camera(i).matrix[0, 0] for i in range(4)] == [76.5, 76, 75.5, 75]
    prints = {sequence.fingerprint, small.fingerprint}
    stored["frames"][0]["fl_x"] = 149.0
    change(folder / "transforms.json", frames=stored["frames"])
    assert nerfstudio(folder)[0].fingerprint not in prints


def test_two_cameras_are_two_sequences(tmp_path):
    folder = write_nerfstudio(tmp_path / "rig", 5)
    stored = json.loads((folder / "transforms.json").read_text())
    for frame in stored["frames"][:2]:
        frame["k1"] = 0.05
    change(folder / "transforms.json", frames=stored["frames"])
    sequences = nerfstudio(folder)
    assert [(s.name, len(s)) for s in sequences] == [("rig_0", 3), ("rig_1", 2)]
    stored["frames"][0]["k1"] = 0.06
    change(folder / "transforms.json", frames=stored["frames"])
    with pytest.warns(InputWarning, match="2 images of .* are the only ones of their camera"):
        assert [len(s) for s in nerfstudio(folder)] == [3]


def test_without_depth_and_with_some(tmp_path):
    (sequence,) = nerfstudio(write_nerfstudio(tmp_path / "none", depth=False))
    assert sequence.depth(0) is None
    folder = write_nerfstudio(tmp_path / "some")
    (folder / "depths" / "frame_00002.png").unlink()
    with pytest.warns(InputWarning, match="1 have no depth map and 0 no pose"):
        (sequence,) = nerfstudio(folder)
    assert [sequence.depth(i) is None for i in range(4)] == [False, True, False, False]


def test_depth_as_arrays(tmp_path):
    folder = write_nerfstudio(tmp_path, 2)
    stored = json.loads((folder / "transforms.json").read_text())
    for i, frame in enumerate(reversed(stored["frames"])):
        frame["depth_file_path"] = f"depths/{i}.npy"
        np.save(folder / frame["depth_file_path"], render(i, K, SIZE)[1])
    change(folder / "transforms.json", frames=stored["frames"])
    (sequence,) = nerfstudio(folder, depth_unit=1.0)
    np.testing.assert_allclose(sequence.depth(1), render(1, K, SIZE)[1], rtol=1e-6)
    data = (folder / "depths" / "1.npy").read_bytes()
    for content in (data[:-100], data[:20], b"", np.array([{}], object).dumps()):
        (folder / "depths" / "1.npy").write_bytes(content)
        with pytest.raises(BadInputError, match=r"1\.npy is no array of numpy"):
            sequence.depth(1)


def test_images_that_are_missing(tmp_path):
    folder = write_nerfstudio(tmp_path)
    (folder / "images" / "frame_00002.png").unlink()
    with pytest.warns(InputWarning, match="1 of the 4 images that .* names are missing"):
        (sequence,) = nerfstudio(folder)
    np.testing.assert_allclose(sequence.pose(1), pose(2), atol=1e-12)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"camera_model": "EQUIRECTANGULAR"}, "camera_model EQUIRECTANGULAR"),
        ({"fl_x": None}, "no finite number fl_x"),
        ({"fl_y": -1.0}, "focal lengths 150, -1 "),
        ({"fl_y": 10**400}, "no finite number fl_y"),
        ({"k1": 1e10}, "no pinhole camera shows"),
        ({"k1": float("inf")}, "no finite number k1"),
        ({"w": float("inf")}, "no finite number w"),
        ({"w": 10**8, "h": 10**8, "k1": 0.1}, "can't be of images of 100000000x100000000"),
        ({"frames": {}}, "no list of frames"),
        ({"frames": [1]}, "frame 0 of .* has no file_path"),
        ({"frames": []}, "no two images of one camera"),
        ({"frames": [{"file_path": "../a.png"}]}, "leaves the folder"),
    ],
)
def test_files_that_make_no_sense(tmp_path, keys, message):
    change(write_nerfstudio(tmp_path, 2) / "transforms.json", **keys)
    with pytest.raises(BadInputError, match=message):
        nerfstudio(tmp_path)


@pytest.mark.parametrize(
    "matrix",
    [None, "here", np.zeros((4, 4)).tolist(), [[1, 0], [0, 1]], np.full((4, 4), 1e400).tolist(), [[10**400] * 4] * 4],
)
def test_poses_that_are_none(tmp_path, matrix):
    folder = write_nerfstudio(tmp_path, 2)
    stored = json.loads((folder / "transforms.json").read_text())
    stored["frames"][0]["transform_matrix"] = matrix
    change(folder / "transforms.json", frames=stored["frames"])
    with pytest.raises(BadInputError, match=r"transform_matrix of frame_00002\.png .* is no pose"):
        nerfstudio(folder)


def test_not_json_and_a_folder_of_scenes(tmp_path):
    for name in ("a", "b"):
        write_nerfstudio(tmp_path / "all" / name, 2, depth=False)
    assert [s.name for s in nerfstudio(tmp_path / "all")] == ["all_a", "all_b"]
    (tmp_path / "all" / "a" / "transforms.json").write_text("{")
    with pytest.raises(BadInputError, match="not readable as JSON"):
        nerfstudio(tmp_path / "all" / "a")
    with pytest.raises(BadInputError, match=r"data\.depth_unit"):
        nerfstudio(tmp_path / "all", depth_unit=0)


def test_depth_lies_where_the_camera_sees_it(tmp_path):
    (sequence,) = nerfstudio(write_nerfstudio(tmp_path, 2, LENS), max_side=96)
    camera = sequence.camera(1)
    xy = np.stack(np.meshgrid(np.arange(camera.size[0]), np.arange(camera.size[1])), -1).reshape(-1, 2)
    depth = sequence.depth(1).ravel()
    known = np.isfinite(depth)
    np.testing.assert_allclose(depth[known], depth_of(xy, pose(1), camera.matrix)[0][known], atol=8e-3)

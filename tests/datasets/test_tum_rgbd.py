import numpy as np
import pytest
from rgbd_files import depth_of, matrix, pose, render, write_tum

from sips_lit.datasets.rgbd import rgbd
from sips_lit.datasets.tum_rgbd import CALIBRATIONS
from sips_lit.errors import BadInputError, InputWarning

K3 = matrix(*CALIBRATIONS[3][0])
SMALL = (160, 120)
SMALL_K = matrix(130.0, 131.0, 79.0, 60.0)


def write_small(folder):
    return write_tum(folder, SMALL_K, size=SMALL)


def open_small(folder, **options):
    return rgbd(folder, intrinsics=[130.0, 131.0, 79.0, 60.0], **options)[0]


def test_as_downloaded(tmp_path):
    folder = write_tum(tmp_path / "rgbd_dataset_freiburg3_made", K3, count=2)
    (sequence,) = rgbd(folder)
    assert (sequence.name, len(sequence)) == ("rgbd_dataset_freiburg3_made", 2)
    image, depth = render(1, K3, (640, 480))
    np.testing.assert_array_equal(sequence.frame(1), image)
    np.testing.assert_allclose(sequence.depth(1), depth, atol=1.1e-4)
    np.testing.assert_allclose(sequence.pose(1), pose(1), atol=1e-6)
    np.testing.assert_array_equal(sequence.camera(0).matrix, K3)
    assert sequence.time(1) - sequence.time(0) == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize("camera", [1, 2])
@pytest.mark.parametrize("max_side", [None, 320])
def test_lenses_of_the_first_two_cameras_are_undistorted(tmp_path, camera, max_side):
    intrinsics, distortion = CALIBRATIONS[camera]
    folder = write_tum(tmp_path / f"rgbd_dataset_freiburg{camera}_x", matrix(*intrinsics), distortion, count=1)
    (sequence,) = rgbd(folder, max_side=max_side)
    pinhole = sequence.camera(0)
    assert pinhole.size == (max_side or 640, (max_side or 640) * 3 // 4)
    expected, expected_depth = render(0, pinhole.matrix, pinhole.size)  # what a lens without distortion would see
    image, depth = sequence.frame(0).astype(float), sequence.depth(0)
    assert np.abs(image - expected).mean() < 3
    assert np.isfinite(depth).all()  # nothing from outside of the stored map
    np.testing.assert_allclose(depth, expected_depth, atol=3e-3)
    bent, _ = render(0, matrix(*intrinsics), (640, 480), distortion)
    straight, _ = render(0, matrix(*intrinsics), (640, 480))
    assert np.abs(bent.astype(float) - straight).mean() > 6  # the test can tell


def test_images_without_depth_or_pose_are_counted_or_left_out(tmp_path):
    folder = write_small(tmp_path / "any")
    lines = (folder / "depth.txt").read_text().splitlines()
    (folder / "depth.txt").write_text("\n".join(lines[:-1]))
    with pytest.warns(UserWarning, match=r"of 3 images of .* 1 have no depth map and 0 no pose"):
        sequence = open_small(folder)
    assert [sequence.depth(i) is None for i in range(3)] == [False, False, True]
    truth = (folder / "groundtruth.txt").read_text().splitlines()
    (folder / "groundtruth.txt").write_text("\n".join(truth[7:]))
    with pytest.warns(UserWarning, match="1 have no depth map and 1 no pose"):
        changed = open_small(folder)
    assert [changed.pose(i) is None for i in range(3)] == [True, False, False]
    assert changed.fingerprint != sequence.fingerprint
    (folder / "depth.txt").write_text("\n".join(lines))
    with pytest.warns(UserWarning, match="left out"):
        kept = open_small(folder, drop_incomplete=True)
    assert [kept.frame_name(i) for i in range(len(kept))] == [changed.frame_name(i) for i in (1, 2)]
    np.testing.assert_allclose(kept.pose(0), pose(1), atol=1e-6)
    (folder / "depth.txt").write_text("\n".join(lines[:-1]))
    with pytest.warns(UserWarning, match="left out"), pytest.raises(BadInputError, match="only 1 images"):
        open_small(folder, drop_incomplete=True)


@pytest.mark.parametrize("table", ["depth.txt", "groundtruth.txt"])
def test_another_day(tmp_path, table):
    folder = write_small(tmp_path / "any")
    lines = [line.split(" ", 1) for line in (folder / table).read_text().splitlines()]
    moved = [line if line[0] == "#" else [f"{float(line[0]) + 86400:.6f}", line[1]] for line in lines]
    (folder / table).write_text("\n".join(" ".join(line) for line in moved))
    with pytest.raises(BadInputError, match=rf"{table} does not overlap in time with rgb\.txt"):
        open_small(folder)


def test_a_wider_tolerance_joins_more(tmp_path):
    folder = write_small(tmp_path / "any")
    with pytest.raises(BadInputError, match=r"depth\.txt .* within 0\.005 s"):
        open_small(folder, tolerance=0.005)
    assert open_small(folder, tolerance=0.008).depth(0) is not None  # exactly as far apart


def test_without_lists_the_names_are_the_times(tmp_path):
    whole = open_small(write_small(tmp_path / "whole"))
    folder = write_small(tmp_path / "any")
    (folder / "rgb.txt").unlink()
    (folder / "depth.txt").unlink()
    sequence = open_small(folder)
    assert [sequence.time(i) for i in range(3)] == [whole.time(i) for i in range(3)]
    for i in range(3):
        np.testing.assert_array_equal(sequence.pose(i), whole.pose(i))
        np.testing.assert_array_equal(sequence.depth(i), whole.depth(i))
    (folder / "rgb" / "first.png").write_bytes(b"")
    with pytest.raises(BadInputError, match=r"no .*rgb\.txt, and the images of .* are not named by their times"):
        open_small(folder)


def test_without_poses(tmp_path):
    folder = write_small(tmp_path / "any")
    (folder / "groundtruth.txt").unlink()
    with pytest.warns(InputWarning, match="of 3 images of .* 0 have no depth map and 3 no pose"):
        sequence = open_small(folder)
    assert [sequence.pose(i) for i in range(3)] == [None] * 3
    assert sequence.depth(1) is not None


@pytest.mark.parametrize("missing", ["depth", "depth/1305031102.183300.png"])
def test_half_downloaded(tmp_path, missing):
    folder = write_small(tmp_path / "any")
    (folder / "depth.txt").rename(folder / ("other" if missing == "depth" else "depth.txt"))
    (folder / missing).rename(folder / "elsewhere")
    with pytest.raises(BadInputError, match=rf"there is no .*{missing}.*TUM RGB-D has"):
        open_small(folder)


def test_an_unknown_camera(tmp_path):
    write_small(tmp_path / "office")
    with pytest.raises(BadInputError, match=r"office is not known.*data\.intrinsics"):
        rgbd(tmp_path / "office")
    write_small(tmp_path / "freiburg1_small")
    with pytest.raises(BadInputError, match="160x120"):
        rgbd(tmp_path / "freiburg1_small")
    for wrong in ([1.0, 2.0], [0.0, 100.0, 50.0, 50.0]):
        with pytest.raises(BadInputError, match="intrinsics"):
            rgbd(tmp_path / "office", intrinsics=wrong)


@pytest.mark.parametrize(
    ("table", "line", "message"),
    [
        ("groundtruth.txt", "1305031102.2 0 0 0 0 0 0 0", "quaternion of length 0"),
        ("groundtruth.txt", "1305031102.2 0 0 0 1e308 1e308 0 0", "quaternion of length inf"),
        ("groundtruth.txt", "1305031102.2 0 0 0 0 0 0 2", "quaternion of length 2"),
        ("groundtruth.txt", "1305031102.2 1e300 0 0 0 0 0 1", "no place on earth"),
        ("groundtruth.txt", "1305031102.2 0 0 0", "values"),
        ("rgb.txt", f"1305031102.2 {'a' * 300}.png", "no name of a file"),
        ("rgb.txt", "1305031102.2", "a time and a file"),
        ("rgb.txt", "soon rgb/a.png", "'soon'"),
        ("rgb.txt", "1305031102.2 ../a.png", "leaves the folder"),
        ("depth.txt", "1305031102.2 /tmp/a.png", "leaves the folder"),
    ],
)
def test_lines_that_make_no_sense(tmp_path, table, line, message):
    folder = write_small(tmp_path / "any")
    with (folder / table).open("a") as file:
        file.write(line + "\n")
    with pytest.raises(BadInputError, match=message) as caught:
        open_small(folder)
    assert table in str(caught.value)


def test_the_wall_is_where_the_depth_says(tmp_path):
    sequence = open_small(write_small(tmp_path / "any"))
    xy = np.array([[3, 4], [80, 60], [150, 110]])
    for index in range(3):
        expected, _ = depth_of(xy, sequence.pose(index), sequence.camera(index).matrix)
        np.testing.assert_allclose(sequence.depth(index)[xy[:, 1], xy[:, 0]], expected, atol=1e-3)

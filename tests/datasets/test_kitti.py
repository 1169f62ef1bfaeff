import itertools
import logging
import pickle
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from kitti_files import make_kitti, pose, projection
from textured_scenes import texture

from sips_lit.dataset_tools.recognise import recognise
from sips_lit.datasets.kitti import kitti
from sips_lit.errors import BadInputError


@pytest.mark.parametrize("where", [".", "dataset", "dataset/sequences", "dataset/sequences/00"])
def test_any_folder_of_the_download(tmp_path: Path, where: str):
    make_kitti(tmp_path)
    (sequence,) = kitti(tmp_path / where)
    assert (sequence.name, len(sequence), sequence.frame_name(2)) == ("kitti_00", 4, "kitti_00_000002")
    np.testing.assert_array_equal(sequence.frame(2), texture(48, 64, 2))
    np.testing.assert_array_equal(sequence.right(3), texture(48, 64, 13))
    assert sequence.time(3) == pytest.approx(0.3)
    np.testing.assert_allclose(sequence.pose(2), pose(2), atol=1e-10)


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("max_side", [None, 33])
def test_geometry_agrees_with_the_published_projections(tmp_path: Path, colour: bool, max_side: int | None):
    (sequence,) = kitti(make_kitti(tmp_path), colour=colour, max_side=max_side)
    left = 2 if colour else 0
    height, width = sequence.frame(0).shape
    assert sequence.right(0).shape == (height, width) == ((48, 64) if max_side is None else (25, 33))
    assert sequence.camera(1).size == (width, height)
    scale = np.array([width / 64, height / 48])
    world = np.array([0.7, -0.4, 9.0, 1.0])
    grey_camera = np.linalg.inv(pose(2)) @ world
    pixels = [(p[:2] / p[2] + 0.5) * scale - 0.5 for p in (projection(left + side) @ grey_camera for side in (0, 1))]
    x, y, depth = sequence.camera(2).matrix @ (np.linalg.inv(sequence.pose(2)) @ world)[:3]
    np.testing.assert_allclose((x / depth, y / depth), pixels[0], atol=1e-6)
    disparity = sequence.camera(2).matrix[0, 0] * sequence.baseline() / depth
    np.testing.assert_allclose((x / depth - disparity, y / depth), pixels[1], atol=1e-6)


def test_colour_is_read_as_grey(tmp_path: Path):
    (sequence,) = kitti(make_kitti(tmp_path), colour=True)
    colour = cv2.imread(str(tmp_path / "dataset/sequences/00/image_2/000001.png"), cv2.IMREAD_GRAYSCALE)
    assert np.abs(sequence.frame(1).astype(int) - colour).max() <= 1
    with pytest.raises(BadInputError, match=r"no .*image_2 with colour images, but image_0: set data\.colour=false"):
        kitti(make_kitti(tmp_path / "grey", cameras=(0, 1)), colour=True)
    with pytest.raises(BadInputError, match=r"set data\.colour=true, or download the grey images"):
        kitti(make_kitti(tmp_path / "colour", cameras=(2, 3)))


def test_splits_and_sequences(tmp_path: Path):
    dataset = make_kitti(tmp_path, tuple(f"{i:02d}" for i in range(22)), cameras=(0,), frames=2)
    every = [s.name for s in kitti(dataset)]
    assert every == [s.name for s in kitti(dataset, split="all")]
    splits = [[s.name for s in kitti(dataset, split=split)] for split in ("train", "validation", "test")]
    assert splits[1:] == [["kitti_05"], ["kitti_00"]]
    assert sorted(itertools.chain(*splits)) == every
    assert [s.name for s in kitti(dataset, sequences=["07", 2])] == ["kitti_07", "kitti_02"]
    assert [s.name for s in kitti(dataset, sequences="00")] == ["kitti_00"]
    with pytest.raises(BadInputError, match="kitti has no split dev"):
        kitti(dataset, split="dev")
    with pytest.raises(BadInputError, match="set one of them"):
        kitti(dataset, split="test", sequences=["00"])
    with pytest.raises(BadInputError, match=r"no sequence 30, only 00, 01"):
        kitti(dataset, sequences=["00", "30"])


def test_a_split_that_is_not_whole(tmp_path: Path):
    with pytest.raises(BadInputError, match=r"has no sequence 05, only 00: download it"):
        kitti(make_kitti(tmp_path), split="validation")


def test_what_is_not_published_is_not_known(tmp_path: Path):
    dataset = make_kitti(tmp_path, cameras=(0,))
    (dataset / "poses" / "00.txt").unlink()
    (dataset / "sequences/00/times.txt").unlink()
    (sequence,) = kitti(dataset)
    assert [sequence.pose(1), sequence.time(1), sequence.right(1), sequence.baseline()] == [None] * 4
    assert sequence.camera(1) is not None


def test_an_excerpt_takes_the_rows_of_its_images(tmp_path: Path):
    dataset = make_kitti(tmp_path)
    for camera in range(4):
        (dataset / f"sequences/00/image_{camera}/000000.png").unlink()
    (sequence,) = kitti(dataset)
    assert (len(sequence), sequence.time(0)) == (3, pytest.approx(0.1))
    np.testing.assert_allclose(sequence.pose(0), pose(1), atol=1e-10)


def drop_last_line(file: Path) -> None:
    file.write_text("\n".join(file.read_text().splitlines()[:-1]) + "\n")


def replace(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda d: drop_last_line(d / "poses/00.txt"), r"poses/00\.txt has 3 rows, too few for .*000003\.png"),
        (lambda d: drop_last_line(d / "sequences/00/times.txt"), r"times\.txt has 3 rows, too few for"),
        (lambda d: replace(d / "poses/00.txt", "9.000000000000e-01", "nan"), r"line 2 of .*00\.txt has 'nan'"),
        (lambda d: replace(d / "poses/00.txt", "9.000000000000e-01", ""), r"line 2 of .*00\.txt has 11 values, not 12"),
        (lambda d: (d / "sequences/00/calib.txt").unlink(), r"no .*calib\.txt: .*00 has image_0/.*the layout of KITTI"),
        (lambda d: replace(d / "sequences/00/calib.txt", "P0:", "P9:"), r"calib\.txt has no line P0:"),
        (lambda d: replace(d / "sequences/00/calib.txt", "P0: 1", "P0: -1"), r"line 1 of .*calib\.txt is no 3x4"),
        (lambda d: replace(d / "sequences/00/calib.txt", "e+02 ", "inf "), r"line 1 of .*calib\.txt has '1\.0+inf'"),
        (
            lambda d: replace(d / "sequences/00/calib.txt", "P0: 1.000000000000e+02", "P0: 1e-300"),
            r"line 1 of .* is the projection of no",
        ),
        (
            lambda d: replace(d / "sequences/00/calib.txt", "P0: 1.000000000000e+02", "P0: 1e6"),
            r"calib\.txt has focal lengths 1e\+06, 100 and the centre .* can't be of images of 64x48",
        ),
        (
            lambda d: replace(d / "sequences/00/calib.txt", "-5.0", "5.0"),
            r"calib\.txt says that the right camera is -0\.5 m to the right of the left one",
        ),
        (
            lambda d: (d / "sequences/00/image_1/000002.png").unlink(),
            r"1 of 4 right images .* is .*image_1/000002\.png",
        ),
        (lambda d: (d / "sequences/00/image_0/000002.png").rename(d / "sequences/00/image_0/a.png"), r"a\.png is not"),
        (lambda d: [f.unlink() for f in (d / "sequences/00/image_0").iterdir()], r"there is no .*image_0"),
    ],
)
def test_half_a_download(tmp_path: Path, damage, message: str):
    dataset = make_kitti(tmp_path, cameras=(0, 1))
    damage(dataset)
    with pytest.raises(BadInputError, match=message) as caught:
        kitti(dataset)
    assert "\n" not in str(caught.value)


def test_right_images_of_another_size(tmp_path: Path):
    dataset = make_kitti(tmp_path)
    for file in (dataset / "sequences/00/image_1").iterdir():
        cv2.imwrite(str(file), texture(40, 64))
    with pytest.raises(BadInputError, match=r"image_1 are not of the size of those of .*image_0"):
        kitti(dataset)[0].right(0)


def test_wrong_folders(tmp_path: Path):
    (tmp_path / "photos").mkdir()
    for path, found in (
        (tmp_path, "has photos/"),
        (tmp_path / "photos", "is empty"),
        (tmp_path / "x/y", "does not exist"),
    ):
        with pytest.raises(BadInputError, match=rf"there is no sequence in .*{found}.*; the layout of KITTI"):
            kitti(path)


def test_fingerprint_tells_the_options_and_the_files(tmp_path: Path):
    dataset = make_kitti(tmp_path)
    prints = [kitti(dataset)[0].fingerprint]
    assert kitti(dataset / "sequences")[0].fingerprint == prints[0]
    prints += [kitti(dataset, max_side=32)[0].fingerprint, kitti(dataset, colour=True)[0].fingerprint]
    for file in ("sequences/00/calib.txt", "poses/00.txt", "sequences/00/image_1/000001.png"):
        with (dataset / file).open("ab") as stream:
            stream.write(b"\n")
        prints.append(kitti(dataset)[0].fingerprint)
    assert len(set(prints)) == 6


def test_pickles(tmp_path: Path):
    (sequence,) = kitti(make_kitti(tmp_path), max_side=40)
    other = pickle.loads(pickle.dumps(sequence))
    np.testing.assert_array_equal(other.right(1), sequence.right(1))
    np.testing.assert_array_equal(other.pose(1), sequence.pose(1))


def test_images_that_are_not_there_are_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    folder = make_kitti(tmp_path, frames=6) / "sequences" / "00"
    with caplog.at_level(logging.WARNING):
        kitti(folder)
        assert caplog.records == []
        for camera in range(4):
            (folder / f"image_{camera}" / "000002.png").unlink()
            (folder / f"image_{camera}" / "000005.png").unlink()
        (sequence,) = kitti(folder)
    assert [record.getMessage() for record in caplog.records] == [
        f"kitti_00: 4 of 6 images of {folder / 'image_0'} are there"
    ]
    np.testing.assert_allclose(sequence.time(2), 0.3)


@pytest.mark.parametrize("cameras", [(0, 1), (2, 3)])
def test_jpegs(tmp_path: Path, cameras: tuple[int, int]):
    make_kitti(tmp_path, cameras=cameras)
    for file in (tmp_path / "dataset").rglob("*.png"):
        assert cv2.imwrite(str(file.with_suffix(".jpg")), cv2.imread(str(file), cv2.IMREAD_UNCHANGED))
        file.unlink()
    (dataset,) = recognise(tmp_path)
    assert dataset.spec.kind == "kitti"
    (sequence,) = dataset.sequences()
    assert (len(sequence), sequence.right(3) is None) == (4, False)
    assert {file.suffix for file in sequence.files} == {".jpg"}
    np.testing.assert_allclose(sequence.pose(2)[:3, :3], pose(2)[:3, :3], atol=1e-10)


def test_two_formats(tmp_path: Path):
    left = make_kitti(tmp_path) / "sequences" / "00" / "image_0"
    (left / "000002.png").rename(left / "000002.jpg")
    (sequence,) = kitti(tmp_path)
    assert (sequence.frame_name(2), sequence.right(2).shape) == ("kitti_00_000002", (48, 64))
    shutil.copy(left / "000002.jpg", left / "000002.png")
    with pytest.raises(BadInputError, match=r"image_0 has 1 images twice, the first is 000002\.jpg"):
        kitti(tmp_path)

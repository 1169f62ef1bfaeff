import contextlib
import csv
from dataclasses import replace
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
import pytest
from textured_scenes import keypoints, texture

from sips_lit.baselines.precomputed import HlocFile
from sips_lit.describe.sift import RootSift
from sips_lit.errors import BadInputError
from sips_lit.inference.streams import Frame
from sips_lit.inference.writers import CsvWriter, NpzWriter, PictureWriter, VideoWriter, open_writer
from sips_lit.render.points import draw_points
from sips_lit.types import Keypoints

POINTS = keypoints([[1 / 3, 20.1], [30, 7.7777777]], [0.1, 1e-7], 2**0.5)


def frame(name: str = "a", height: int = 48, width: int = 64) -> Frame:
    grey = texture(height, width)
    return Frame(name, grey, np.dstack([grey, 255 - grey, grey // 2]))


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_npz(tmp_path):
    writer = NpzWriter(tmp_path / "deep" / "points")
    writer.write(frame(), POINTS)
    assert writer.written == "1 npz file"
    writer.write(frame("b", 5, 9), Keypoints.empty())
    writer.close()
    assert writer.written == "2 npz files"
    assert names(writer.folder) == ["a.npz", "b.npz"]
    with np.load(writer.folder / "a.npz", allow_pickle=False) as stored:
        assert sorted(stored) == ["image_size", "keypoints", "scales", "scores"]
        np.testing.assert_array_equal(stored["keypoints"], POINTS.xy)
        np.testing.assert_array_equal(stored["scores"], POINTS.score)
        np.testing.assert_array_equal(stored["scales"], POINTS.scale)
        np.testing.assert_array_equal(stored["image_size"], [64, 48])
        assert {stored[name].dtype for name in ("keypoints", "scores", "scales")} == {np.dtype(np.float32)}
    with np.load(writer.folder / "b.npz") as stored:
        assert stored["keypoints"].shape == (0, 2)
        assert stored["scores"].shape == (0,)
        np.testing.assert_array_equal(stored["image_size"], [9, 5])


def test_csv_reads_back_exactly(tmp_path):
    writer = CsvWriter(tmp_path / "new" / "points.csv")
    writer.write(frame("a,b"), POINTS)
    writer.write(frame("none"), Keypoints.empty())
    assert not writer.table.path.exists()  # half a table would look like a whole one
    writer.close()
    assert names(writer.table.path.parent) == ["points.csv"]
    with writer.table.path.open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    assert writer.written == "points.csv (2 rows)"
    assert [row["frame"] for row in rows] == ["a,b", "a,b"]
    for column, expected in (("x", POINTS.xy[:, 0]), ("y", POINTS.xy[:, 1]), ("score", POINTS.score)):
        np.testing.assert_array_equal(np.array([row[column] for row in rows], np.float32), expected)
    np.testing.assert_array_equal(np.array([row["scale"] for row in rows], np.float32), POINTS.scale)


def test_covariances_are_written_with_the_points_that_have_them(tmp_path):
    covariance = np.array([[[0.1, -1 / 3], [-1 / 3, 4]], [[9, 0.5], [0.5, 0.25]]], np.float32)
    points = replace(POINTS, covariance=covariance)
    for writer in (NpzWriter(tmp_path), CsvWriter(tmp_path / "points.csv")):
        writer.write(frame(), points)
        writer.close()
    np.testing.assert_array_equal(np.load(tmp_path / "a.npz")["covariances"], covariance)
    with (tmp_path / "points.csv").open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    read = np.array([[row["xx"], row["xy"], row["yy"]] for row in rows], np.float32)
    np.testing.assert_array_equal(read, covariance[:, [0, 0, 1], [0, 1, 1]])


def test_a_table_without_points_has_its_head(tmp_path):
    CsvWriter(tmp_path / "points.csv").close()
    assert (tmp_path / "points.csv").read_text() == "frame,x,y,score,scale\n"


def test_pictures(tmp_path):
    writer = PictureWriter(tmp_path / "overlay")
    assert writer.written == "overlay/ (0 pictures)"
    writer.write(frame(), POINTS)
    assert writer.written == "overlay/ (1 picture)"
    writer.write(frame("b", 7, 9), Keypoints.empty())
    writer.close()
    drawn = cv2.imread(str(tmp_path / "overlay" / "a.png"))[:, :, ::-1]
    np.testing.assert_array_equal(drawn, draw_points(frame().picture, POINTS))
    assert cv2.imread(str(tmp_path / "overlay" / "b.png")).shape == (7, 9, 3)


@pytest.mark.parametrize("size", [(48, 64), (49, 65)])
def test_a_video_is_there_when_it_is_finished(tmp_path, size):
    writer = VideoWriter(tmp_path / "new" / "overlay.mp4", 12.5)
    for name in "abc":
        writer.write(frame(name, *size), POINTS)
    assert "overlay.mp4" not in names(tmp_path / "new")
    writer.close()
    assert names(tmp_path / "new") == ["overlay.mp4"]
    assert writer.written == "overlay.mp4 (3 frames)"
    capture = cv2.VideoCapture(str(writer.path))
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(12.5)
    frames = []
    while (read := capture.read())[0]:
        frames.append(read[1])
    capture.release()
    assert [image.shape for image in frames] == [(48, 64, 3)] * 3  # even sizes only
    expected = draw_points(frame("a", *size).picture, POINTS)[:48, :64, ::-1]
    assert np.abs(frames[0].astype(int) - expected).mean() < 20  # as good as the codec allows


FEATURE_FILES = {"hloc": "features.h5", "colmap": "database.db", "colmap_text": "colmap_text"}


@pytest.mark.parametrize("kind", FEATURE_FILES)
def test_features_with_descriptors(tmp_path, kind):
    if kind == "hloc":
        pytest.importorskip("h5py", reason="it writes hloc's files: pip install h5py")
    writer = open_writer(kind, tmp_path / "new", None, RootSift())
    writer.write(Frame("a", frame().grey, frame().picture, "a.JPG"), POINTS)
    assert writer.written == f"{FEATURE_FILES[kind]} (1 image)"
    writer.write(frame("b"), Keypoints.empty())
    writer.close()
    writer.close()
    assert writer.written == f"{FEATURE_FILES[kind]} (2 images)"
    assert names(tmp_path / "new") == [FEATURE_FILES[kind]]
    if kind == "colmap_text":
        assert names(tmp_path / "new" / "colmap_text") == ["a.JPG.txt", "b.png.txt"]
    if kind == "hloc":
        saved = HlocFile(tmp_path / "new" / "features.h5").read(PurePosixPath("a.JPG"))
        np.testing.assert_array_equal(saved.keypoints, POINTS.xy)
        np.testing.assert_array_equal(saved.descriptors, RootSift().describe(frame().grey, POINTS))
        assert saved.image_size == (64, 48)


@pytest.mark.parametrize("kind", ["hloc", "colmap"])
def test_names_that_are_no_utf8(tmp_path, kind):
    if kind == "hloc":
        pytest.importorskip("h5py", reason="it writes hloc's files: pip install h5py")
    closing = contextlib.closing(open_writer(kind, tmp_path, None))
    with closing as writer, pytest.raises(BadInputError, match="is no UTF-8"):
        writer.write(Frame("a", frame().grey, frame().picture, "a\udcff.png"), POINTS)


@pytest.mark.parametrize("kind", ["hloc", "colmap", "colmap_text"])
def test_features_on_a_full_disk(full_disk, kind):
    if kind == "hloc":
        pytest.importorskip("h5py", reason="it writes hloc's files: pip install h5py")

    def filled(count: int) -> None:
        with contextlib.closing(open_writer(kind, full_disk, None, RootSift())) as writer:
            for index in range(count):
                writer.write(frame(f"{index}"), keypoints(np.full((500, 2), 20.0)))

    filled(1)
    before = (full_disk / FEATURE_FILES[kind]).stat().st_ino
    with pytest.raises(BadInputError, match=f"cannot write {full_disk}/.*the disk {full_disk} is full"):
        filled(100)
    assert (full_disk / FEATURE_FILES[kind]).stat().st_ino == before
    assert not list(full_disk.rglob(".*"))


@pytest.mark.parametrize("kind", [NpzWriter, CsvWriter, PictureWriter, VideoWriter])
def test_on_a_full_disk_the_old_result_stays(full_disk, kind):
    path = full_disk / {CsvWriter: "points.csv", VideoWriter: "overlay.mp4"}.get(kind, "out")

    def filled(count: int) -> None:
        writer = VideoWriter(path, 25) if kind is VideoWriter else kind(path)
        noise = np.random.default_rng(0).integers(0, 256, (480, 640, 3), np.uint8)
        n = 2000 if kind in (NpzWriter, CsvWriter) else 1  # pictures fill the disk by themselves
        many = Keypoints(*(np.full(shape, 1 / 3, np.float32) for shape in ((n, 2), (n,), (n,))))
        with contextlib.closing(writer):
            for index in range(count):
                writer.write(Frame(f"{index}", noise[:, :, 0], noise), many)

    filled(1)
    before = {file: file.read_bytes() for file in full_disk.rglob("*") if file.is_file()}
    with pytest.raises(BadInputError, match=f"cannot write {full_disk}/.*the disk {full_disk}.* free some space"):
        filled(100)
    after = {file: file.read_bytes() for file in full_disk.rglob("*") if file.is_file()}
    assert {file: after[file] for file in before} == before
    assert not [file for file in after if file.name.startswith(".")]


def test_no_frames_no_video(tmp_path):
    VideoWriter(tmp_path / "overlay.mp4", 25).close()
    assert names(tmp_path) == []


def test_a_video_that_cannot_be_written(tmp_path):
    writer = VideoWriter(tmp_path / "overlay.nonsense", 25)
    with pytest.raises(BadInputError, match="cannot write a video of 64x48 pixels"):
        writer.write(frame(), POINTS)
    writer.close()
    assert names(tmp_path) == []


def test_which_writer(tmp_path):
    assert isinstance(open_writer("npz", tmp_path, None), NpzWriter)
    table = open_writer("csv", tmp_path, 25)
    assert isinstance(table, CsvWriter)
    table.close()
    assert isinstance(open_writer("overlay", tmp_path, None), PictureWriter)
    video = open_writer("overlay", tmp_path, 30)
    assert isinstance(video, VideoWriter)
    assert (video.path, video.fps) == (tmp_path / "overlay.mp4", 30)


@pytest.mark.parametrize("kind", ["npz", "csv", "overlay"])
@pytest.mark.parametrize("fps", [None, 25])
def test_a_file_in_place_of_the_folder(tmp_path, kind, fps):
    (tmp_path / "taken").touch()
    with pytest.raises(BadInputError, match="cannot make the folder"):
        open_writer(kind, tmp_path / "taken", fps)


def test_folders_in_place_of_the_files(tmp_path):
    for name in ("points.csv", "a.npz", "overlay/a.png"):
        (tmp_path / name).mkdir(parents=True)
    with pytest.raises(BadInputError, match=r"cannot write .*points\.csv"):
        open_writer("csv", tmp_path, None)
    for kind, name in (("npz", "a.npz"), ("overlay", "a.png")):
        with pytest.raises(BadInputError, match=f"cannot write .*{name}"):
            open_writer(kind, tmp_path, None).write(frame(), POINTS)

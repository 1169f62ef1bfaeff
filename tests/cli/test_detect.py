import contextlib
import csv
import shutil
import sqlite3
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from textured_scenes import flight, texture

from sips_lit.baselines.precomputed import PrecomputedDetector
from sips_lit.cli.detect import choose_device, formats
from sips_lit.describe.sift import RootSift
from sips_lit.detect.checkpoint import export_safetensors, load_checkpoint
from sips_lit.detect.detector import SipsDetector
from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey


@pytest.fixture
def detect(command, checkpoint, folders):
    """Runs sips-detect on an input; what it writes is in ``points``."""

    def run(given: object, *arguments: str):
        paths = f"checkpoint={checkpoint}", f"input={given}", f"output={folders}/points"
        return command("detect", *paths, "device=cpu", *arguments)

    return run


@pytest.fixture
def mixed(tmp_path) -> Path:
    """Images of different kinds and sizes."""
    folder = tmp_path / "mixed"
    folder.mkdir()
    colour = np.dstack([texture(61, 87, seed) for seed in (1, 2, 3)])
    for name, image in (("a10.png", texture(96, 128)), ("a2.jpg", colour), ("b.png", texture(1, 1))):
        assert cv2.imwrite(str(folder / name), image)
    return folder


def read(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as stored:
        return dict(stored)


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as handle:
        return list(csv.DictReader(handle))


def names(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_an_image(detect, frames, folders, checkpoint):
    result = detect(frames / "003.png", "n=20")
    assert result.code == 0, result.err
    assert names(folders / "points") == ["003.npz", "overlay/003.png", "points.csv"]
    stored = read(folders / "points" / "003.npz")
    points = SipsDetector.from_checkpoint(checkpoint)(frames / "003.png", n=20)
    np.testing.assert_array_equal(stored["keypoints"], points.xy)
    np.testing.assert_array_equal(stored["scores"], points.score)
    np.testing.assert_array_equal(stored["scales"], points.scale)
    np.testing.assert_array_equal(stored["image_size"], [128, 96])
    assert cv2.imread(str(folders / "points" / "overlay" / "003.png")).shape == (96, 128, 3)
    assert "1 frame, 20.0 points per frame on average (the best 20)" in result.out
    assert f"wrote to {folders}/points: 1 npz file, points.csv (20 rows), overlay/ (1 picture)" in result.out


def test_a_folder_of_mixed_images(detect, mixed, folders, checkpoint):
    result = detect(mixed, "n=12")
    assert result.code == 0, result.err
    detector, rows = SipsDetector.from_checkpoint(checkpoint), table(folders / "points" / "points.csv")
    assert list(dict.fromkeys(row["frame"] for row in rows)) == ["a2", "a10", "b"]
    for name, size in (("a2.jpg", (87, 61)), ("a10.png", (128, 96)), ("b.png", (1, 1))):
        stem = Path(name).stem
        stored, points = read(folders / "points" / f"{stem}.npz"), detector(mixed / name, n=12)
        np.testing.assert_array_equal(stored["keypoints"], points.xy)
        np.testing.assert_array_equal(stored["scores"], points.score)
        assert tuple(stored["image_size"]) == size
        own = [row for row in rows if row["frame"] == stem]
        np.testing.assert_array_equal(np.array([[row["x"], row["y"]] for row in own], np.float32), points.xy)
        np.testing.assert_array_equal(np.array([row["score"] for row in own], np.float32), points.score)
        assert cv2.imread(str(folders / "points" / "overlay" / f"{stem}.png")).shape == (size[1], size[0], 3)
    # colour stays colour
    assert np.ptp(cv2.imread(str(folders / "points" / "overlay" / "a2.png")), axis=2).mean() > 10


def test_a_video(detect, folders, tmp_path, checkpoint):
    path = tmp_path / "drive.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (128, 96))
    for frame in flight(5, size=(128, 96)).frames:
        writer.write(cv2.applyColorMap(frame, cv2.COLORMAP_JET))
    writer.release()
    result = detect(path, "n=15")
    assert result.code == 0, result.err
    expected = [*(f"drive_{index:06d}.npz" for index in range(5)), "overlay.mp4", "points.csv"]
    assert names(folders / "points") == expected
    assert len(table(folders / "points" / "points.csv")) == 75
    source, overlay = cv2.VideoCapture(str(path)), cv2.VideoCapture(str(folders / "points" / "overlay.mp4"))
    detector = SipsDetector.from_checkpoint(checkpoint)
    for index in range(5):
        image = source.read()[1]
        points = detector(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), n=15)
        np.testing.assert_array_equal(read(folders / "points" / expected[index])["keypoints"], points.xy)
        assert overlay.read()[1].shape == (96, 128, 3)
    assert not overlay.read()[0]
    assert overlay.get(cv2.CAP_PROP_FPS) == pytest.approx(10)
    assert "5 frames" in result.out
    assert "overlay.mp4 (5 frames)" in result.out


def test_a_video_that_ends_early_is_told(detect, tmp_path):
    path = tmp_path / "cut.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (128, 96))
    for frame in flight(8, size=(128, 96)).frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    result = detect(path, "format=csv")
    assert result.code == 0, result.err
    assert "warning: " in result.err
    assert f"{path} is damaged: it ends early" in result.err
    assert result.err.count("damaged") == 1


@pytest.mark.parametrize("wanted", ["npz", "csv", "overlay", "[csv,npz]"])
def test_formats(detect, frames, folders, wanted):
    result = detect(frames / "000.png", f"format={wanted}")
    assert result.code == 0, result.err
    written = {"npz": "000.npz", "csv": "points.csv", "overlay": "overlay/000.png"}
    expected = sorted(written[kind] for kind in wanted.strip("[]").split(","))
    assert names(folders / "points") == expected


def test_formats_of_other_programs(detect, frames, folders, checkpoint):
    pytest.importorskip("h5py", reason="it writes hloc's files: pip install h5py")
    result = detect(frames, "n=20", "format=[hloc,colmap,colmap_text]")
    assert result.code == 0, result.err
    assert "features.h5 (16 images), database.db (16 images), colmap_text (16 images)" in result.out
    points, image = SipsDetector.from_checkpoint(checkpoint)(frames / "003.png", n=20), read_grey(frames / "003.png")
    # what we write is what we read
    saved = PrecomputedDetector(folders / "points" / "features.h5", frames).detect_and_describe(image, 20)
    np.testing.assert_array_equal(saved.keypoints.xy, points.xy)
    np.testing.assert_array_equal(saved.descriptors, RootSift().describe(image, points))
    with contextlib.closing(sqlite3.connect(folders / "points" / "database.db")) as sql:
        query = "SELECT data FROM keypoints JOIN images USING (image_id) WHERE name = '003.png'"
        (data,) = sql.execute(query).fetchone()
        assert sql.execute("SELECT COUNT(*) FROM cameras").fetchone() == (1,)
    np.testing.assert_array_equal(np.frombuffer(data, np.float32).reshape(20, 4)[:, :2], points.xy + 0.5)
    rows = (folders / "points" / "colmap_text" / "003.png.txt").read_text().splitlines()
    assert len(rows) == 21


def test_descriptors_of_other_programs(detect, frames, folders):
    assert detect(frames / "000.png", "format=colmap", "descriptor=own").code == 0
    assert "COLMAP matches SIFT descriptors" in detect(frames, "format=colmap", "descriptor=orb").sentence
    assert "choose descriptor=rootsift or sift" in detect(frames, "format=colmap_text", "descriptor=own").sentence


def test_threshold(detect, frames, folders, checkpoint):
    scores = SipsDetector.from_checkpoint(checkpoint)(frames / "000.png", n=40).score
    result = detect(frames / "000.png", "n=40", f"threshold={float(scores[9]):.9f}", "format=npz")
    assert result.code == 0, result.err
    np.testing.assert_array_equal(read(folders / "points" / "000.npz")["scores"], scores[:10])
    assert "of those with P(inlier) >=" in result.out
    assert detect(frames / "000.png", "threshold=1", "format=npz").code == 0
    assert read(folders / "points" / "000.npz")["keypoints"].shape == (0, 2)


def test_as_few_as_give_k_inliers(detect, frames, folders, checkpoint):
    assert detect(frames / "000.png", "k=3", "confidence=0.9", "format=npz").code == 0
    scores = read(folders / "points" / "000.npz")["scores"].astype(np.float64)

    def chance(p: np.ndarray) -> float:
        """P(at least 3 inliers), by the distribution of their number."""
        exactly = np.ones(1)
        for each in p:
            exactly = np.convolve(exactly, [1 - each, each])
        return float(exactly[3:].sum())

    assert chance(scores[:-1]) < 0.9 <= chance(scores)


def test_frames_without_enough_points_are_told(detect, frames, folders):
    result = detect(frames, "k=10", "confidence=0.99", "n_max=11", "format=csv")
    assert result.code == 0, result.err
    assert "16 of them have too few good points for 10 inliers with probability 0.99" in result.out
    assert len(table(folders / "points" / "points.csv")) == 16 * 11


def test_suppression_and_fit_as_asked(detect, frames, folders):
    assert detect(frames / "000.png", "n=500", "nms_radius=12", "subpixel=false", "format=npz").code == 0
    xy = read(folders / "points" / "000.npz")["keypoints"]
    np.testing.assert_array_equal(xy, np.rint(xy))
    assert 3 < len(xy) <= 88
    assert (np.abs(xy[:, None] - xy).max(2) + 99 * np.eye(len(xy))).min() > 12


def test_several_scales_as_asked(detect, frames, folders):
    assert detect(frames / "000.png", "n=500", "scales=3", "format=npz").code == 0
    assert set(np.round(read(folders / "points" / "000.npz")["scales"] ** 2)) == {1, 2, 4}


def test_a_second_run_replaces_the_first(detect, frames, folders):
    assert detect(frames, "n=30").code == 0
    assert detect(frames, "n=5").code == 0
    assert len(table(folders / "points" / "points.csv")) == 80
    assert len(read(folders / "points" / "007.npz")["scores"]) == 5


def test_nothing_but_the_results_is_written(detect, frames, folders, monkeypatch):
    (folders / "here").mkdir()
    monkeypatch.chdir(folders / "here")
    assert detect(frames / "000.png").code == 0
    assert sorted(path.name for path in folders.iterdir()) == ["here", "points"]
    assert not list((folders / "here").iterdir())


def test_what_came_before_a_damaged_image_stays(detect, frames, folders, tmp_path):
    folder = tmp_path / "frames"
    shutil.copytree(frames, folder)
    (folder / "002.png").write_bytes((folder / "002.png").read_bytes()[:300])
    result = detect(folder, "n=5")
    assert "002.png is not an image that OpenCV can read" in result.sentence
    assert "2 frames (of 16 announced)" in result.out
    assert names(folders / "points") == ["000.npz", "001.npz", "overlay/000.png", "overlay/001.png", "points.csv"]
    assert len(table(folders / "points" / "points.csv")) == 10


def test_input_that_is_not_there(detect, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").write_text("text")
    assert "holds no images" in detect(tmp_path / "empty").sentence
    assert "there is no" in detect(tmp_path / "gone").sentence
    assert "neither an image nor a video" in detect(tmp_path / "notes.txt").sentence


def test_output_that_cannot_be(command, checkpoint, frames, tmp_path):
    (tmp_path / "taken").touch()
    arguments = f"checkpoint={checkpoint}", f"input={frames}", f"output={tmp_path}/taken"
    assert "cannot make the folder" in command("detect", *arguments).sentence


def test_input_must_be_set(command):
    assert command("detect").sentence == "input is not set: add input=... to the command"


def test_an_image_alone_is_enough(command, frames, tmp_path, monkeypatch):
    """Released weights, 50 points, into ``points``."""
    monkeypatch.chdir(tmp_path)
    result = command("detect", f"input={frames}/000.png")
    assert result.code == 0, result.err
    np.testing.assert_array_equal(
        read(tmp_path / "points" / "000.npz")["keypoints"],
        SipsDetector.from_pretrained()(frames / "000.png", n=50).xy,
    )


@pytest.mark.parametrize(
    ("argument", "reason"),
    [
        ("n=-1", "n is -1"),
        ("n=many", "n has a value of the wrong type"),
        ("n=1.5", "n has a value of the wrong type"),
        ("threshold=1.5", "threshold is 1.5"),
        ("k=0", "k is 0"),
        ("confidence=1", "confidence is 1"),
        ("n_max=0", "n_max is 0"),
        ("nms_radius=-1", "nms_radius is -1"),
        ("scales=0", "1 to 32 scales"),
        ("format=png", "format is png"),
        ("format=[]", "format is []"),
        ("device=tpu", "device is tpu"),
        ("checkpoint=gone.ckpt", "there is no checkpoint gone.ckpt"),
    ],
)
def test_values_out_of_range(detect, frames, folders, argument, reason):
    assert reason in detect(frames / "000.png", argument).sentence
    assert not (folders / "points").exists()


def test_unknown_keys_are_refused(detect, frames):
    result = detect(frames, "points=10")
    assert result.code != 0
    assert "points" in result.err


def test_a_diverged_checkpoint(command, checkpoint, frames, tmp_path):
    network, selector = load_checkpoint(checkpoint)
    with torch.no_grad():
        network.layers[0].bias.fill_(torch.nan)
    export_safetensors(network, selector, tmp_path / "nan.safetensors")
    arguments = f"checkpoint={tmp_path}/nan.safetensors", f"input={frames}", f"output={tmp_path}/out"
    assert "not finite" in command("detect", *arguments).sentence


def test_devices(monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    assert choose_device("auto") == choose_device("cpu") == torch.device("cpu")
    with pytest.raises(BadInputError, match="finds no GPU"):
        choose_device("cuda")
    monkeypatch.setattr("torch.cuda.is_available", lambda: True)
    assert choose_device("auto") == choose_device("cuda") == torch.device("cuda")


def test_formats_come_in_one_order():
    assert formats("csv") == ["csv"]
    assert formats(["overlay", "npz", "npz"]) == ["npz", "overlay"]
    for bad in (None, 3, "", [], ["npz", "png"], {"npz": 1}):
        with pytest.raises(BadInputError, match="give one or several of npz, hloc, colmap, colmap_text, csv, overlay"):
            formats(bad)

"""What docs/first-sessions.md tells newcomers to type, typed: in an empty folder, with a small video and small logs."""

import csv
import importlib
import shlex
import sqlite3
import sys

import cv2
import numpy as np
import pytest
from documented_package import write_documented_package
from markdown_code import blocks
from textured_scenes import flight

PAGE = "docs/first-sessions.md"


@pytest.fixture
def home(folders, monkeypatch):
    """The folder of a newcomer."""
    monkeypatch.chdir(folders)
    monkeypatch.syspath_prepend(str(folders))
    writer = cv2.VideoWriter("my.mp4", cv2.VideoWriter.fourcc(*"mp4v"), 10, (160, 120))
    for frame in flight(16).frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    yield folders
    for name in [name for name in sys.modules if name.partition(".")[0] == "my_package"]:
        del sys.modules[name]


def typed(section: int) -> list[list[str]]:
    """The sips commands of a block of shell of the page."""
    block = [block for block in blocks("bash") if block.page == PAGE][section]
    lines = (shlex.split(line, comments=True) for line in block.text.splitlines())
    return [words for words in lines if words and words[0].startswith("sips-")]


def run_all(command, section: int) -> list[str]:
    told = []
    for name, *arguments in typed(section):
        result = command(name.removeprefix("sips-"), *arguments)
        assert result.code == 0, result.err
        told.append(result.out)
    return told


def run_python(section: int, names: dict) -> dict:
    block = [block for block in blocks("python") if block.page == PAGE][section]
    exec(compile(block.text, str(block), "exec"), names)
    return names


def write_logs(folder):
    """Two logs as the page about data sets has them."""
    for name, seed in (("first", 1), ("second", 2)):
        (folder / name / "images").mkdir(parents=True)
        for index, frame in enumerate(flight(12, seed=seed).frames):
            cv2.imwrite(str(folder / name / "images" / f"{index:03d}.png"), frame)
        np.savetxt(folder / name / "poses.txt", np.tile(np.eye(4)[:3].ravel(), (12, 1)))
        np.savetxt(folder / name / "camera.txt", [[100, 0, 80], [0, 100, 60], [0, 0, 1]])


def test_a_video_into_opencv_and_colmap(home, command, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["sips-data", "check", "my.mp4"])
    (name, *arguments), *_ = typed(1)
    assert (name, arguments) == ("sips-data", ["check", "my.mp4"])
    run = importlib.import_module("sips_lit.cli.data").main
    with pytest.raises(SystemExit) as stop:
        run(arguments)
    assert stop.value.code == 0
    for name, *arguments in typed(1)[1:]:
        result = command(name.removeprefix("sips-"), *arguments)
        assert result.code == 0, result.err
    assert len(list((home / "points").glob("my_*.npz"))) == 16
    with (home / "matches" / "pairs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["pair"][-6:] for row in rows] == ["000005", "000010", "000015"]
    assert all(int(row["inliers"]) > 50 for row in rows)
    with sqlite3.connect(home / "colmap" / "database.db") as database:
        assert database.execute("SELECT COUNT(*) FROM images").fetchone() == (16,)
    names = run_python(0, {})
    assert len(names["keypoints"]) == 50
    assert len(names["turns"]) == 15


@pytest.mark.slow
def test_a_detector_of_ones_own_in_a_table(home, command, capsys):
    write_documented_package(home)
    (told,) = run_all(command, 2)
    assert all(name in told for name in ("SIPs + RootSIFT", "SIFT", "ORB", "Blobs + RootSIFT"))
    assert (home / "outputs" / "table" / "report.html").is_file()
    run_python(1, {})
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 6  # SIFT and ORB also with their own descriptors
    assert sum(line.startswith("Blobs + RootSIFT ") for line in lines) == 1


@pytest.mark.slow
def test_a_data_set_of_ones_own(home, command):
    write_documented_package(home)
    write_logs(home / "logs")
    _, told = run_all(command, 3)
    assert "Blobs + RootSIFT" in told
    assert (home / "outputs" / "rover" / "report.html").is_file()


def test_nothing_of_the_page_is_left_out():
    assert [[words[0] for words in typed(section)] for section in range(4)] == [
        [],
        ["sips-data", "sips-detect", "sips-match", "sips-detect"],
        ["sips-benchmark"],
        ["sips-index", "sips-benchmark"],
    ]
    assert len([block for block in blocks("python") if block.page == PAGE]) == 2

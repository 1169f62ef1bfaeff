import shlex
import zipfile

import cv2
import numpy as np
import pytest
import yaml
from cli_runs import write_frames
from hpatches_files import write_sequence
from hydra.core.override_parser.overrides_parser import OverridesParser
from own_dataset import write_walk
from rgbd_files import write_simple
from robotcar_files import write_run
from textured_scenes import flight

import sips_lit
from sips_lit.cli import data as command
from sips_lit.cli.arguments import as_typed
from sips_lit.cli.data import main


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return stop.value.code, out, err


@pytest.fixture
def images(tmp_path):
    folder = tmp_path / "frames"
    folder.mkdir()
    for i, frame in enumerate(flight(5).frames):
        cv2.imwrite(str(folder / f"{i}.png"), frame)
    return folder


@pytest.mark.parametrize(
    ("option", "told"), [("--help", "sips-data stats my.mp4"), ("--version", f"sips-data {sips_lit.__version__}")]
)
def test_it_says_what_it_is_for(option, told, capsys):
    with pytest.raises(SystemExit) as stop:
        main([option])
    assert stop.value.code == 0
    assert told in capsys.readouterr().out


def test_check_says_what_it_is_and_how_to_use_it(images, capsys):
    code, out, _ = run(capsys, "check", images)
    assert code == 0
    assert "folder of images" in out
    assert f"sips-train data=folder data.path={images}" in out


def test_check_fails_on_a_damaged_file(images, capsys):
    (images / "3.png").write_bytes(b"damaged")
    code, out, err = run(capsys, "check", images)
    assert code == 1
    assert "3.png" in out
    assert err.startswith("error: ")


def test_a_damaged_image_is_told_in_one_sentence_only(tmp_path, capfd):
    write_sequence(tmp_path)
    (tmp_path / "v_made/3.ppm").write_bytes((tmp_path / "v_made/3.ppm").read_bytes()[:500])
    code, out, err = run(capfd, "check", tmp_path)
    assert code == 1
    assert out.count("3.ppm") == 1
    assert err == "error: some of the data does not open: see above\n"  # nothing of OpenCV's own


def test_check_of_an_empty_folder_is_one_sentence(tmp_path, capsys):
    code, out, err = run(capsys, "check", tmp_path)
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert "is empty" in err


def test_stats_writes_a_table_and_a_picture(images, tmp_path, capsys):
    picture = tmp_path / "out" / "stats.png"
    code, out, _ = run(capsys, "stats", images, "--output", picture, "--cache", tmp_path / "cache")
    assert code == 0
    assert "reach 0.1" in out
    assert cv2.imread(str(picture)) is not None


def test_stats_tells_of_frames_that_cannot_be_read(images, tmp_path, capsys):
    (images / "2.png").write_bytes((images / "2.png").read_bytes()[:300])
    code, out, err = run(capsys, "stats", images, "--output", tmp_path / "stats.png", "--cache", tmp_path / "cache")
    assert code == 1
    assert "reach 0.1" in out
    assert "are left out (1); the first: " in err
    assert "2.png" in err


def test_check_says_what_else_the_command_needs(tmp_path, capsys):
    write_sequence(tmp_path)
    _, out, _ = run(capsys, "check", tmp_path)
    assert f"sips-train data=hpatches data.path={tmp_path} inliers=homography datamodule.val_fraction=0.34" in out
    write_run(tmp_path / "run", camera="stereo/left")
    _, out, _ = run(capsys, "check", tmp_path / "run")
    assert "data=robotcar" in out
    assert "data.camera=stereo/left" in out


def test_a_data_set_of_another_package(installed, tmp_path, capsys, command):
    installed()
    folder = write_walk(tmp_path / "walk", flight(5, size=(96, 80)).frames)
    code, out, _ = run(capsys, "check", folder)
    assert code == 0
    assert f"{folder}: Walks (known by walk.npz)" in out
    assert "| walk       | 5        | 96x80  | 20.0       | times |" in out
    used = next(line for line in out.splitlines() if line.startswith("use: sips-train "))
    assert used.endswith(f" data=walk data.path={folder} 'hydra.searchpath=[pkg://walks.conf]'")
    result = command("index", *shlex.split(used)[2:])  # what it recommends works
    assert result.code == 0, result.err
    assert "| walk       |        5 |" in result.out
    code, out, _ = run(capsys, "stats", folder, "--output", tmp_path / "stats.png", "--cache", tmp_path / "cache")
    assert code == 0
    assert "| walk " in out


def test_check_says_which_inliers_can_be_had(tmp_path, capsys):
    folder = write_simple(tmp_path / "desk", 3)
    _, out, _ = run(capsys, "check", folder)
    assert "- inliers=klt, stereo_p3p or pose_depth labels and verifies its pairs" in out
    (folder / "cam.json").unlink()
    _, out, _ = run(capsys, "check", folder)
    assert "inliers=" not in out


@pytest.fixture
def catalogue(tmp_path):
    """One data set whose file is a zip on this disk."""
    with zipfile.ZipFile(tmp_path / "tiny.zip", "w") as archive:
        archive.writestr("frames/1.png", cv2.imencode(".png", np.zeros((9, 9), np.uint8))[1].tobytes())
    url = (tmp_path / "tiny.zip").as_uri()
    entry = {"title": "Tiny", "page": "https://example.org", "data": "folder", "path": "frames"}
    path = tmp_path / "catalogue.yaml"
    path.write_text(yaml.safe_dump({"tiny": {**entry, "files": [{"url": url, "bytes": 100}]}}))
    return path


def test_download_says_the_size_and_needs_a_yes(catalogue, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(command, "remote_size", lambda url: 123_000_000)
    code, out, err = run(capsys, "download", "tiny", "--catalogue", catalogue, "--output", tmp_path / "d")
    assert code == 1
    assert "0.12 GB" in out
    assert "--yes" in err
    assert not (tmp_path / "d").exists()


def test_download_unpacks_and_does_not_fetch_twice(catalogue, tmp_path, capsys, monkeypatch):
    fetched = []

    def fetch(file, folder):
        folder.mkdir(parents=True, exist_ok=True)
        fetched.append(file.name)
        (folder / file.name).write_bytes((tmp_path / "tiny.zip").read_bytes())
        return folder / file.name

    monkeypatch.setattr(command, "remote_size", lambda url: None)
    monkeypatch.setattr(command, "fetch", fetch)
    arguments = ("download", "tiny", "--yes", "--catalogue", catalogue, "--output", tmp_path / "d")
    code, out, _ = run(capsys, *arguments)
    assert code == 0
    assert (tmp_path / "d/tiny/frames/1.png").exists()
    assert f"data.path={tmp_path / 'd/tiny/frames'}" in out
    code, out, _ = run(capsys, *arguments)
    assert (code, fetched) == (0, ["tiny.zip"])
    place = tmp_path / "d/tiny/frames"
    (place / "1.png").unlink()
    write_sequence(place)
    _, out, _ = run(capsys, *arguments)  # what is there tells how to use it
    assert out.endswith(f"data=hpatches data.path={place} inliers=homography datamodule.val_fraction=0.34\n")


def test_without_a_name_the_offers_are_listed(capsys):
    code, out, _ = run(capsys, "download")
    assert code == 0
    assert "hpatches" in out
    assert "GB" in out


def test_an_unknown_name_lists_the_choices(capsys):
    code, _, err = run(capsys, "download", "imagenet")
    assert code == 1
    assert "kitti_odometry" in err


@pytest.mark.parametrize("name", ["2024_01_01", "a (copy) #1", "[1] it's", "null", "~x", "x,y"])
def test_what_check_prints_can_be_pasted(tmp_path, monkeypatch, capsys, name):
    """Through the shell, and what a command makes of it: the folder itself."""
    monkeypatch.chdir(tmp_path)
    write_frames(tmp_path / name, flight(4).frames)
    with pytest.raises(SystemExit):
        main(["check", name])
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("use: "))
    *_, argument = as_typed(shlex.split(line.removeprefix("use: sips-train ")))
    assert OverridesParser.create().parse_override(argument).value() == name


def test_stats_shows_how_pairs_spread_and_warns_of_nothing_but_neighbours(images, tmp_path, capsys):
    arguments = ("--output", tmp_path / "stats.png", "--cache", tmp_path / "cache")
    _, out, _ = run(capsys, "stats", images, *arguments)
    assert "| pairs " in out
    assert "0.4 to 0.6" in out
    assert "neighbours" in out
    assert "almost all pairs" not in out
    for fast, frame in enumerate(flight(4, step=(90, 0)).frames):
        cv2.imwrite(str(images / f"{fast}.png"), frame)
    (images / "4.png").unlink()
    two = tmp_path / "two"
    two.mkdir()
    for i, frame in enumerate(flight(2).frames):
        cv2.imwrite(str(two / f"{i}.png"), frame)
    _, out, _ = run(capsys, "stats", two, *arguments)
    assert "almost all pairs of" in out

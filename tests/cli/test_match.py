import csv
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from cli_runs import write_frames
from stereo_scenes import CAMERA, StereoScene
from textured_scenes import flight, texture

from sips_lit.cli.match import table
from sips_lit.errors import BadInputError
from sips_lit.inference.match import match
from sips_lit.inference.match_stream import open_images


@pytest.fixture
def matched(command, folders):
    """Runs sips-match; what it writes is in ``matches``."""

    def run(*arguments: object):
        return command("match", *map(str, arguments), f"output={folders}/matches")

    return run


def names(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as handle:
        return list(csv.DictReader(handle))


def test_two_images(matched, frames, folders):
    result = matched(frames / "003.png", frames / "005.png", "n=100")
    assert result.code == 0, result.err
    assert names(folders / "matches") == ["003-005.npz", "003-005.png", "matches.csv", "pairs.csv"]
    expected = match(frames / "003.png", frames / "005.png", n=100)
    with np.load(folders / "matches" / "003-005.npz") as stored:
        for key in ("xy0", "xy1", "confidence", "inlier", "homography"):
            np.testing.assert_array_equal(stored[key], getattr(expected, key))
        assert "T_1_0" not in stored
        np.testing.assert_array_equal(stored["image_size0"], [128, 96])
    table = rows(folders / "matches" / "matches.csv")
    np.testing.assert_array_equal(np.float32([[row["x0"], row["y0"]] for row in table]), expected.xy0)
    np.testing.assert_array_equal(np.float32([[row["x1"], row["y1"]] for row in table]), expected.xy1)
    np.testing.assert_array_equal([row["inlier"] == "1" for row in table], expected.inlier)
    (pair,) = rows(folders / "matches" / "pairs.csv")
    numbers = [float(pair[f"h{i}{j}"]) for i in range(3) for j in range(3)]
    np.testing.assert_array_equal(np.reshape(numbers, (3, 3)), expected.homography)
    picture = cv2.imread(str(folders / "matches" / "003-005.png"))
    assert np.array_equal(picture[:, :, ::-1], expected.picture(name="003-005"))
    cells = f"| 003-005 | {len(expected.keypoints0)}"
    assert cells in result.out
    assert f"| {len(expected)}" in result.out
    assert "| homography" in result.out
    assert (
        f"wrote to {folders}/matches: 1 npz file, matches.csv ({len(expected)} rows), pairs.csv (1 rows), 1 picture"
        in (result.out)
    )


def test_a_folder_with_a_stride_and_another_detector(matched, frames, folders):
    result = matched(frames, "stride=5", "n=60", "detector=sift", "descriptor=own", "format=csv")
    assert result.code == 0, result.err
    pairs = rows(folders / "matches" / "pairs.csv")
    assert [row["pair"] for row in pairs] == ["000-005", "005-010", "010-015"]
    assert {row["points0"] for row in pairs} == {"60"}
    assert names(folders / "matches") == ["matches.csv", "pairs.csv"]
    assert len(rows(folders / "matches" / "matches.csv")) == sum(int(row["matches"]) for row in pairs)


def test_a_video(matched, folders, tmp_path):
    path = tmp_path / "drive.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (128, 96))
    for frame in flight(5, size=(128, 96)).frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    result = matched(path, "stride=2", "format=npz", "n=50", "checkpoint=sips-tiny")
    assert result.code == 0, result.err
    assert names(folders / "matches") == ["drive_000000-drive_000002.npz", "drive_000002-drive_000004.npz"]


@pytest.mark.parametrize("kind", ["numbers", "file", "two files"])
def test_a_camera(matched, folders, tmp_path, kind):
    scene = StereoScene(4)
    images = write_frames(tmp_path / "room", [scene.frame(0), scene.frame(3)])
    K = CAMERA.matrix
    file = tmp_path / "my camera.txt"
    np.savetxt(file, K)
    given = {"numbers": f"[{K[0, 0]},{K[1, 1]},{K[0, 2]},{K[1, 2]}]", "file": file, "two files": f"[{file},{file}]"}
    result = matched(images / "000.png", images / "001.png", f"camera={given[kind]}", "n=200", "format=[npz,csv]")
    assert result.code == 0, result.err
    expected = match(scene.frame(0), scene.frame(3), n=200, camera=K)
    with np.load(folders / "matches" / "000-001.npz") as stored:
        np.testing.assert_array_equal(stored["T_1_0"], expected.T_1_0)
        assert "homography" not in stored
    (pair,) = rows(folders / "matches" / "pairs.csv")
    assert float(pair["m03"]) == expected.t[0]
    assert "pose: " in result.out


def test_few_matches_are_told(matched, tmp_path, folders):
    images = write_frames(tmp_path / "blank", [np.full((40, 50), 9, np.uint8), texture(40, 50)])
    result = matched(images, "n=3", "format=csv")
    assert result.code == 0, result.err
    assert "of 4 matches that it needs" in result.out
    (pair,) = rows(folders / "matches" / "pairs.csv")
    assert pair["h00"] == ""


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["{a}", "{a}", "{a}"], "3 images were given"),
        (["{a}", "{dir}/none.png"], "cannot read the image .*none.png"),
        (["{a}"], "there is one image to match"),
        (["{dir}", "stride=99"], "no two frames that are 99 apart"),
        (["{dir}", "stride=0"], "stride is 0"),
        (["{a}", "{a}", "n=-1"], "n is -1"),
        (["{a}", "{a}", "threshold=0"], "threshold is 0"),
        (["{a}", "{a}", "format=pdf"], "format is pdf: give one or several of npz, csv, picture"),
        (["{a}", "{a}", "camera=[1,2,3]"], r"camera is .*: give"),
        (["{a}", "{a}", "camera=none.txt"], "cannot read none.txt"),
        (["{a}", "{a}", "camera=[5000000,5000000,1,1]"], "can't be of images of 128x96"),
        (["{a}", "{a}", "descriptor=own"], "does not describe them"),
        (["{a}", "{a}", "stride=x"], "stride has a value of the wrong type"),
        (["n=50"], "input is not set"),
        (["input=null"], r"input is None: give two images, \[a.jpg,b.jpg\], a folder of images, or a video"),
        (["input=[]"], r"input is \[\]: give two images"),
        (["{a}", "input={dir}"], "there are both .*000.png and input="),
    ],
)
def test_what_is_refused(matched, frames, folders, arguments, reason):
    result = matched(*(argument.format(a=frames / "000.png", dir=frames) for argument in arguments))
    assert re.search(reason, result.sentence)
    assert not (folders / "matches").exists()


def test_what_was_matched_before_an_error_stays(matched, tmp_path, folders):
    images = write_frames(tmp_path / "some", [texture(40, 50, seed) for seed in range(3)])
    (images / "002.png").write_bytes(b"no image")
    result = matched(images, "format=[csv,npz]")
    assert "002.png is not an image" in result.sentence
    assert names(folders / "matches") == ["000-001.npz", "matches.csv", "pairs.csv"]
    assert "| 000-001 |" in result.out


def test_a_long_table_is_cut():
    text = table([[f"pair {i}", "5", 4, 3, "homography"] for i in range(25)])
    assert "pair 19" in text
    assert "pair 20" not in text
    assert "25 pairs in all" in text


def test_more_than_two_images_by_key():
    with pytest.raises(BadInputError, match="3 images were given"):
        open_images([Path("a"), Path("b"), Path("c")])

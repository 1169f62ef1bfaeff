"""Inputs that real cameras, disks and downloads produce, through every command: what is done with each, or said of it."""

import shutil
from collections.abc import Callable
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from cli_runs import TINY, Command, Result, write_frames
from textured_scenes import flight

SCENE = flight(36, size=(128, 96)).frames
EVALUATION = ["detector=sift", "pairs=3", "k=8", "n_max=60", "ks=[]", "n=20", "calibration=[20]"]
BENCHMARK = ["detectors=[sift]", *EVALUATION[1:]]
COMMANDS: dict[str, Callable[[Command, str, Path, Path], Result]] = {
    "train": lambda run, data, path, _: run("train", *TINY, f"data={data}", f"data.path={path}"),
    "index": lambda run, data, path, _: run("index", f"data={data}", f"data.path={path}"),
    "check": lambda run, _, path, __: run("data", "check", str(path)),
    "detect": lambda run, _, path, network: run(
        "detect", f"checkpoint={network}", f"input={path}", "output=points", "format=csv"
    ),
    "evaluate": lambda run, data, path, _: run("evaluate", f"data={data}", f"data.path={path}", *EVALUATION),
    "benchmark": lambda run, data, path, _: run("benchmark", f"data={data}", f"data.path={path}", *BENCHMARK),
}
READING = ["train", "index", "detect"]
JUDGING = ["check", "evaluate", "benchmark"]


def write_video(path: Path, codec: str = "libx264") -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30)
        stream.width, stream.height, stream.pix_fmt, stream.gop_size, stream.bit_rate = 128, 96, "yuv420p", 6, 10**6
        for image in SCENE:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, "gray").reformat(format="yuv420p")))
        container.mux(stream.encode(None))
    return path


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole video, one that is cut short, one with a damaged middle, and files that are no videos that can be read."""
    folder = tmp_path_factory.mktemp("awkward")
    whole = write_video(folder / "whole.mkv").read_bytes()
    (folder / "cut.mkv").write_bytes(whole[: int(0.7 * len(whole))])
    start = len(whole) // 2
    (folder / "hole.mkv").write_bytes(whole[:start] + bytes(900) + whole[start + 900 :])
    (folder / "text.mp4").write_text("no video at all\n" * 99)
    writer = cv2.VideoWriter(str(folder / "odd.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (128, 96))
    for image in SCENE:
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()
    (folder / "odd.avi").write_bytes((folder / "odd.avi").read_bytes().replace(b"MJPG", b"XYZ1"))
    return folder


@pytest.fixture
def run(command: Command, checkpoint: Path, folders: Path, monkeypatch: pytest.MonkeyPatch):
    """``run("train", "video", path)`` runs a command on data."""
    monkeypatch.chdir(folders)
    return lambda name, data, path: COMMANDS[name](command, data, path, checkpoint)


def warnings_of(result: Result) -> list[str]:
    return [line.removeprefix("warning: ") for line in result.err.splitlines() if line.startswith("warning: ")]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_whole_video(run, videos: Path, name: str):
    result = run(name, "video", videos / "whole.mkv")
    assert result.code == 0, result.err
    assert warnings_of(result) == []


@pytest.mark.parametrize("name", READING)
@pytest.mark.parametrize(
    ("file", "said"), [("cut.mkv", "it ends early, after "), ("hole.mkv", "frames are missing in ")]
)
def test_damage_of_a_video_is_told_once_and_the_rest_is_used(run, videos: Path, name: str, file: str, said: str):
    result = run(name, "video", videos / file)
    assert result.code == 0, result.err
    (warning,) = warnings_of(result)
    assert said in warning
    assert file in warning


@pytest.mark.parametrize("name", JUDGING)
@pytest.mark.parametrize(
    ("file", "said"), [("cut.mkv", "it ends early, after "), ("hole.mkv", "frames are missing in ")]
)
def test_damage_of_a_video_is_refused_where_results_depend_on_it(run, videos: Path, name: str, file: str, said: str):
    result = run(name, "video", videos / file)
    text = result.out if name == "check" else result.sentence
    assert result.code == 1
    assert said in text
    assert file in text


@pytest.mark.parametrize("name", COMMANDS)
def test_what_cannot_be_decoded_is_named_with_the_way_to_convert_it(run, videos: Path, name: str):
    result = run(name, "video", videos / "odd.avi")
    assert result.code == 1
    assert "Traceback" not in result.err
    text = result.out + result.err
    assert "(XYZ1)" in text
    assert f"ffmpeg -i {videos / 'odd.avi'} -c:v libx264 -crf 16 odd_h264.mp4" in text


@pytest.mark.parametrize("name", COMMANDS)
def test_what_is_no_video(run, videos: Path, name: str):
    result = run(name, "video", videos / "text.mp4")
    assert result.code == 1
    assert "Traceback" not in result.err
    assert "text.mp4 is no video that can be read" in result.out + result.err


@pytest.mark.parametrize("name", ["train", "index", "evaluate", "benchmark"])
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_list_that_windows_wrote(run, videos: Path, tmp_path: Path, name: str, encoding: str):
    (tmp_path / "list.txt").write_text(f"{videos}/whole.mkv\r\n", encoding=encoding)
    result = run(name, "video", tmp_path / "list.txt")
    assert result.code == 0, result.err


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("folder", ["2024_01_01", "1e3", "a (copy) #1 = ~b"])
def test_names_that_are_numbers_or_grammar(run, folders: Path, name: str, folder: str):
    """Relative, as they are typed."""
    write_frames(folders / folder, SCENE)
    result = run(name, "folder", Path(folder))
    assert result.code == 0, result.err


def write_thermal(folder: Path) -> Path:
    """16-bit images that use 1.6 percent of their range."""
    folder.mkdir()
    for index, image in enumerate(SCENE):
        assert cv2.imwrite(str(folder / f"{index:03d}.png"), 28900 + image.astype(np.uint16) * 4)
    return folder


@pytest.mark.parametrize("name", COMMANDS)
def test_thermal_images(run, tmp_path: Path, name: str):
    result = run(name, "folder", write_thermal(tmp_path / "thermal"))
    assert result.code == 0, result.err
    if name == "check":
        assert "16-bit values, of which 28" in result.out
    if name == "detect":
        assert "50.0 points per frame" in result.out


@pytest.mark.parametrize("name", COMMANDS)
def test_names_that_are_decimal_times(run, tmp_path: Path, name: str):
    """In the order of time a neighbour is near; in another one tracks end and pairs are few."""
    folder = tmp_path / "times"
    folder.mkdir()
    for index, image in enumerate(SCENE):
        assert cv2.imwrite(str(folder / f"{round(1548266470 + index * 0.03, 5)}.png"), image)
    result = run(name, "folder", folder)
    assert result.code == 0, result.err
    assert warnings_of(result) == []
    if name == "check":
        assert "33.3" in result.out
        assert "steps back" not in result.out


def test_times_that_step_back_are_shown(command: Command, tmp_path: Path):
    folder = write_frames(tmp_path / "back", SCENE[:6])
    for index, file in enumerate(sorted(folder.iterdir())):
        file.rename(folder / f"a{index}_{1548266470 - index}.png")
    assert command("data", "check", str(folder)).code == 0


@pytest.mark.parametrize("name", ["train", "index", "evaluate"])
def test_frames_that_are_not_used_are_told(command: Command, videos: Path, name: str):
    more = {"train": TINY, "index": [], "evaluate": EVALUATION}[name]
    result = command(name, "data=video", f"data.path={videos}/whole.mkv", "data.max_frames=20", *more)
    assert result.code == 0, result.err
    assert warnings_of(result) == [f"{videos}/whole.mkv is longer than data.max_frames=20: the rest is not used"]


@pytest.mark.parametrize("name", ["train", "index", "check", "evaluate"])
def test_other_files_of_a_folder_are_counted_and_named(run, videos: Path, tmp_path: Path, name: str):
    shutil.copy(videos / "whole.mkv", tmp_path / "a.MKV")
    for other in ("a.lrv", "._a.mkv", "a.srt"):
        (tmp_path / other).write_text("no video")
    result = run(name, "video", tmp_path)
    assert result.code == 0, result.err
    assert "2 files are no videos and are not read: a.lrv, a.srt" in result.out + result.err


@pytest.mark.shared_data
@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("file", ["gap.mp4", "cam.MTS", "pi.h264", "vfr.webm", "drop.avi", "av1.mp4", "rot.mp4"])
def test_whole_files_of_cameras(run, shared_cases: Path, name: str, file: str):
    result = run(name, "video", shared_cases / file)
    assert result.code == 0, result.err
    assert warnings_of(result) == []
    if name != "train":
        assert "60" in result.out

"""Inputs that real cameras, disks and downloads produce, through every command: what is done with each, or said of it.

A matrix of kinds and commands. All cells of a file share one folder of indexes and decoded frames, as a user's commands do:
what is said of a file must not depend on which of them decoded it.
"""

import re
import shutil
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import rgbd_layouts
from cli_runs import TINY, Command, Result, write_frames
from rgbd_files import SIMPLE_K, SIMPLE_SIZE, pose, render
from textured_scenes import flight

from sips_lit.types import GreyImage

FLIGHT = flight(30, size=(128, 96)).frames
SCENE = FLIGHT[:24]
EVALUATION = ["detector=sift", "pairs=3", "k=8", "n_max=60", "ks=[]", "n=20", "calibration=[20]", "pictures=false"]
BENCHMARK = ["detectors=[sift]", *EVALUATION[1:]]
DATA = ["train", "index", "evaluate", "benchmark"]
READING = ["train", "index", "check", "detect", "evaluate", "benchmark"]
NETWORK = ["detect", "evaluate", "benchmark", "export"]  # what takes a checkpoint
COMMANDS = [*READING, "export"]


def arguments(name: str, data: str, path: Path, network: Path, place: Path) -> list[str]:
    given = [f"data={data}", f"data.path={path}", *(["inliers=pose_depth"] if data == "posed_depth" else [])]
    return {
        "train": [*TINY, *given],
        "index": given[:2],
        "check": ["check", str(path)],
        "detect": [f"checkpoint={network}", f"input={path}", f"output={place / 'points'}", "format=csv"],
        "evaluate": [*given, *EVALUATION],
        "benchmark": [*given, *BENCHMARK],
        "export": [
            f"checkpoint={path if path.suffix else path / 'net.safetensors'}",
            f"output={place / 'exported.safetensors'}",
        ],
    }[name]


@dataclass(frozen=True)
class Kind:
    """``make`` writes an input into an empty folder and returns its path; ``data``: the loader for it.

    ``says``: for commands, separated by spaces, the only warning (a regular expression; empty: there is none), or "error: "
    and the sentence that it is refused with. ``shows``: what else is printed.
    """

    make: Callable[[Path], Path]
    says: dict[str, str]
    data: str = "folder"
    shows: dict[str, str] | None = None

    def said(self, name: str) -> str:
        return next(text for names, text in self.says.items() if name in names.split())


def write_video(path: Path, codec: str = "libx264", frames: Sequence[GreyImage] = FLIGHT) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30)
        stream.height, stream.width = frames[0].shape
        stream.pix_fmt, stream.gop_size, stream.bit_rate = "yuv420p", 6, 10**6
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, "gray").reformat(format="yuv420p")))
        container.mux(stream.encode(None))
    return path


def cut(folder: Path) -> Path:
    whole = write_video(folder / "cut.mkv").read_bytes()
    (folder / "cut.mkv").write_bytes(whole[: int(0.7 * len(whole))])
    return folder / "cut.mkv"


def hole(folder: Path) -> Path:
    whole = write_video(folder / "hole.mkv").read_bytes()
    start = len(whole) // 2
    (folder / "hole.mkv").write_bytes(whole[:start] + bytes(900) + whole[start + 900 :])
    return folder / "hole.mkv"


def long_sound(folder: Path) -> Path:
    """5000 packets of sound between two frames, as cameras write them, which OpenCV takes for the end."""
    path = folder / "sound.mkv"
    with av.open(str(write_video(folder / "mute.mkv"))) as mute, av.open(str(path), "w") as container:
        pictures = container.add_stream_from_template(mute.streams.video[0])
        sound = container.add_stream("pcm_s16le", rate=8000)
        for number, packet in enumerate(packet for packet in mute.demux(video=0) if packet.size):
            packet.stream = pictures
            container.mux(packet)
            for step in range(5000 if number == 14 else 0):
                samples = av.AudioFrame.from_ndarray(np.zeros((1, 8), np.int16), layout="mono")
                samples.sample_rate, samples.pts = 8000, step * 8
                container.mux(sound.encode(samples))
    (folder / "mute.mkv").unlink()
    return path


def two_sizes(folder: Path) -> Path:
    """A stream whose camera was switched to another size."""
    larger = flight(30, size=(160, 120), seed=1).frames
    parts = [write_video(folder / f"{i}.h264", frames=frames) for i, frames in enumerate((FLIGHT, larger))]
    (folder / "sizes.h264").write_bytes(b"".join(part.read_bytes() for part in parts))
    for part in parts:
        part.unlink()
    return folder / "sizes.h264"


def turned(folder: Path) -> Path:
    """Stills of a camera that was held upright, as their EXIF says."""
    (folder / "stills").mkdir()
    orientation = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    for index, image in enumerate(SCENE):
        jpeg = cv2.imencode(".jpg", image)[1].tobytes()
        exif = b"\xff\xe1" + (len(orientation) + 2).to_bytes(2, "big") + orientation
        (folder / "stills" / f"{index:03d}.jpg").write_bytes(jpeg[:2] + exif + jpeg[2:])
    return folder / "stills"


def odd_codec(folder: Path) -> Path:
    path = write_video(folder / "odd.avi", codec="mpeg4")
    path.write_bytes(path.read_bytes().replace(b"FMP4", b"XYZ1"))
    return path


def no_video(folder: Path) -> Path:
    (folder / "text.mp4").write_text("no video at all\n" * 99)
    return folder / "text.mp4"


def video_list(encoding: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        write_video(folder / "whole.mkv")
        (folder / "list.txt").write_text("whole.mkv\r\n", encoding=encoding)
        return folder / "list.txt"

    return make


def with_others(folder: Path) -> Path:
    write_video(folder / "whole.mkv").rename(folder / "a.MKV")
    for other in ("a.lrv", "._a.mkv", "a.srt"):
        (folder / other).write_text("no video")
    return folder


def named(name: str) -> Callable[[Path], Path]:
    return lambda folder: write_frames(folder / name, SCENE)


def thermal(folder: Path) -> Path:
    """16-bit images that use 1.6 percent of their range."""
    return write_frames(folder / "thermal", [28900 + image.astype(np.uint16) * 4 for image in SCENE])


def decimal_times(folder: Path) -> Path:
    """In the order of time a neighbour is near; in another one tracks end and pairs are few."""
    (folder / "times").mkdir()
    for index, image in enumerate(SCENE):
        assert cv2.imwrite(str(folder / "times" / f"{round(1548266470 + index * 0.03, 5)}.png"), image)
    return folder / "times"


def colour_and_depth(folder: Path) -> Path:
    folder = write_frames(folder / "both", SCENE)
    for index in range(len(SCENE)):
        assert cv2.imwrite(str(folder / f"{index:03d}_depth.png"), np.full((96, 128), 1000 + index, np.uint16))
    return folder


def stray(folder: Path) -> Path:
    """Two recordings, a picture beside them, and what a notebook leaves."""
    write_frames(folder / "two" / "a", SCENE)
    write_frames(folder / "two" / ".ipynb_checkpoints", SCENE[:3])
    write_frames(folder / "two" / "b", SCENE)
    assert cv2.imwrite(str(folder / "two" / "overview.png"), SCENE[0][:50])
    return folder / "two"


def posed_depth(folder: Path) -> Path:
    """A wall before a camera, with its depth, packed."""
    rendered = [render(i, SIMPLE_K, SIMPLE_SIZE) for i in range(16)]
    write_frames(folder, [image for image, _ in rendered])
    np.savetxt(folder / "poses.txt", [pose(i)[:3].ravel() for i in range(16)])
    np.savetxt(folder / "cam.txt", SIMPLE_K)
    np.savez_compressed(folder / "depth_160x120.npz", **{f"{i:03d}": depth for i, (_, depth) in enumerate(rendered)})
    return folder


def damaged_depth(folder: Path) -> Path:
    """Bytes in the middle of each depth map but those of the frames that are kept for validation."""
    archive = posed_depth(folder) / "depth_160x120.npz"
    with zipfile.ZipFile(archive) as packed:
        starts = [member.header_offset + 1000 for member in packed.infolist()[:11]]
    content = bytearray(archive.read_bytes())
    for start in starts:
        content[start : start + 100] = bytes(100)
    archive.write_bytes(content)
    return folder


def infinite_camera(folder: Path) -> Path:
    (posed_depth(folder) / "cam.txt").write_text("inf 0 81\n0 152 58.5\n0 0 1\n")
    return folder


def overlong(folder: Path) -> Path:
    return folder / ("a" * 300)


GROUPS = " ".join(DATA)
ALL = " ".join(READING)
KINDS = {
    "whole video": Kind(lambda f: write_video(f / "whole.mkv"), {ALL: ""}, "video"),
    "video cut short": Kind(
        cut,
        {
            "train index detect": r"cut\.mkv.*it ends early, after ",
            "evaluate benchmark check": r"error: .*it ends early, after ",
        },
        "video",
    ),
    "video with a damaged middle": Kind(
        hole,
        {
            "train index detect": "hole.mkv is damaged: frames are missing in ",
            "evaluate benchmark check": "error: .*frames are missing",
        },
        "video",
    ),
    "long sound between two frames": Kind(long_sound, {ALL: ""}, "video", {"check": "| 30 "}),
    "a stream that changes its size": Kind(two_sizes, {ALL: ""}, "video", {"check": "160x120"}),
    "stills that are turned": Kind(turned, {ALL: ""}, shows={"check": "96x128"}),
    "codec that can't be decoded": Kind(
        odd_codec, {ALL: r"error: .*\(XYZ1\).*ffmpeg -i \S*odd\.avi -c:v libx264 -crf 16 odd_h264\.mp4"}, "video"
    ),
    "no video": Kind(no_video, {ALL: r"error: .*text\.mp4 is no video that can be read"}, "video"),
    "list with a byte order mark": Kind(video_list("utf-8-sig"), {GROUPS: ""}, "video"),
    "list in UTF-16": Kind(video_list("utf-16"), {GROUPS: ""}, "video"),
    "other files beside videos": Kind(
        with_others,
        {GROUPS + " check": "2 files are no videos and are not read: a.lrv, a.srt"},
        "video",
    ),
    "decimal times": Kind(decimal_times, {ALL: ""}, shows={"check": "33.3"}),
    "part of 16 bits": Kind(
        thermal, {ALL: ""}, shows={"check": "16-bit values, of which 28", "detect": "50.0 points per frame"}
    ),
    "colour and depth in one folder": Kind(
        colour_and_depth,
        {
            GROUPS: r"error: .*different kinds, 24 \*\.png .*, 24 \*_depth\.png \(16-bit grey\): set 'data\.names=\*\.png",
            "check": "24 files are no frames and are not read: 000_depth.png, ",
            "detect": r"error: .*different kinds, 24 \*\.png .*, 24 \*_depth\.png \(16-bit grey\): set 'names=\*\.png'",
        },
        shows={"check": "data=folder data.path=both 'data.names=*.png'"},
    ),
    "nerfstudio": Kind(
        lambda f: rgbd_layouts.write_nerfstudio(f, 14),
        {GROUPS + " check": ""},
        "nerfstudio",
        {"check": "data=nerfstudio"},
    ),
    "stray pictures": Kind(
        stray, {GROUPS + " check": "the images in its folders are read, its own are not: overview.png"}
    ),
    "a damaged depth map": Kind(
        damaged_depth,
        {
            "train": r"error: 20 training pairs in a row can't be read; the first: 0\d\d\.npy in .*npz is damaged",
            "index detect": "",
            "check evaluate benchmark": r"error: 0\d\d\.npy in .*depth_160x120\.npz is damaged",
        },
        "posed_depth",
    ),
    "infinity in a camera": Kind(
        infinite_camera, {GROUPS + " check": r"error: .*cam\.txt has 'inf': every number must be finite"}, "posed_depth"
    ),
    "a name that is too long": Kind(overlong, {ALL + " export": "error: .*at most 255 bytes"}),
    **{
        f"the name {name}": Kind(named(name), {ALL + " export": ""})
        for name in ("2024_01_01", "1e3", "a (copy) #1 = ~b")
    },
}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, Path]]:
    """For a kind, its input, made once, and the folder that the commands share."""
    made: dict[str, tuple[Path, Path]] = {}

    def get(kind: str) -> tuple[Path, Path]:
        if kind not in made:
            place = tmp_path_factory.mktemp("awkward")
            (place / "input").mkdir()
            made[kind] = KINDS[kind].make(place / "input"), place
        return made[kind]

    return get


def warnings_of(result: Result) -> list[str]:
    return [line.removeprefix("warning: ") for line in result.err.splitlines() if line.startswith("warning: ")]


CELLS = [(kind, name) for kind in KINDS for names in KINDS[kind].says for name in names.split()]


@pytest.mark.parametrize(("kind", "name"), CELLS, ids=["-".join(cell).replace(" ", "_") for cell in CELLS])
def test_every_kind_through_every_command(
    command: Command, checkpoint: Path, inputs, monkeypatch, kind: str, name: str
):
    path, place = inputs(kind)
    monkeypatch.setenv("SIPS_LIT_DATA", str(place / "data"))
    monkeypatch.setenv("SIPS_LIT_OUTPUTS", str(place / "outputs"))
    monkeypatch.chdir(place / "input")
    path = path.relative_to(place / "input") if path.parent == place / "input" else path
    if name == "export" and kind != "a name that is too long":
        shutil.copy(checkpoint, path / "net.safetensors")
    result = command({"check": "data"}.get(name, name), *arguments(name, KINDS[kind].data, path, checkpoint, place))
    said = KINDS[kind].said(name)
    assert "Traceback" not in result.err
    if said.startswith("error: "):
        assert result.code == 1
        assert re.search(
            said.removeprefix("error: "), result.out + result.err if name == "check" else result.sentence, re.DOTALL
        )
    else:
        assert result.code == 0, result.err
        assert len(warnings_of(result)) == bool(said), result.err
        assert re.search(said, result.err)
    assert (KINDS[kind].shows or {}).get(name, "") in result.out


DAMAGED = {
    "a checkpoint that is cut": lambda whole: whole[: len(whole) // 2],
    "a checkpoint that is text": lambda whole: b"no network at all",
    "an empty checkpoint": lambda whole: b"",
}


@pytest.mark.parametrize("suffix", ["ckpt", "safetensors", "onnx"])
@pytest.mark.parametrize("kind", DAMAGED)
@pytest.mark.parametrize("name", NETWORK)
def test_checkpoints(
    command: Command, checkpoint: Path, frames: Path, tmp_path: Path, name: str, kind: str, suffix: str
):
    """The others read none: sips-train's is in test_resuming.py."""
    path = tmp_path / f"net.{suffix}"
    path.write_bytes(DAMAGED[kind](checkpoint.read_bytes()))
    given = arguments(name, "folder", path if name == "export" else frames, path, tmp_path)
    more = {
        "evaluate": ["detector=sips", f"checkpoint={path}"],
        "benchmark": ["detectors=[sips]", f"checkpoint={path}"],
    }
    assert f"{path} can't be read" in command(name, *given, *more.get(name, [])).sentence


@pytest.mark.parametrize("name", ["train", "index", "evaluate"])
def test_frames_that_are_not_used_are_told(command: Command, inputs, name: str):
    path, place = inputs("whole video")
    given = arguments(name, "video", path, path, place)
    result = command(name, *given, "data.max_frames=20")
    assert result.code == 0, result.err
    assert warnings_of(result) == [f"{path} is longer than data.max_frames=20: the rest is not used"]


@pytest.mark.shared_data
@pytest.mark.parametrize("name", READING)
@pytest.mark.parametrize("file", ["gap.mp4", "cam.MTS", "pi.h264", "vfr.webm", "drop.avi", "av1.mp4", "rot.mp4"])
def test_whole_files_of_cameras(
    command: Command, checkpoint: Path, shared_cases: Path, tmp_path_factory, monkeypatch, name: str, file: str
):
    place = tmp_path_factory.getbasetemp() / f"camera-{file}"
    monkeypatch.setenv("SIPS_LIT_DATA", str(place / "data"))
    given = arguments(name, "video", shared_cases / file, checkpoint, place)
    small = [] if name in ("check", "detect") else ["data.max_side=160"]
    result = command({"check": "data"}.get(name, name), *given, *small)
    assert result.code == 0, result.err
    assert warnings_of(result) == []
    if name != "train":
        assert "60" in result.out

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from textured_scenes import flight
from video_files import decoded, frames_of, one, write_video

import sips_lit.frames.video as video_module
from sips_lit.errors import BadInputError
from sips_lit.frames.images import resize_max_side
from sips_lit.frames.video import video


@pytest.mark.parametrize(("codec", "suffix"), [("MJPG", ".avi"), ("mp4v", ".mp4")])
def test_frames_equal_a_direct_decode(tmp_path: Path, codec: str, suffix: str):
    path = write_video(tmp_path / ("my clip" + suffix), flight().frames, codec)
    (shot,) = video(path, tmp_path / "cache")
    assert (shot.name, len(shot), shot.frame_name(3)) == ("my_clip", 12, "my_clip_000003")
    np.testing.assert_array_equal(frames_of(shot), decoded(path))


@pytest.mark.parametrize("stride", [1, 2, 3, 11])
@pytest.mark.parametrize("max_frames", [2, 5, 12, 5000])
def test_stride_and_max_frames(clip: Path, tmp_path: Path, stride: int, max_frames: int):
    expected = decoded(clip)[::stride][:max_frames]
    np.testing.assert_array_equal(one(clip, tmp_path, stride=stride, max_frames=max_frames), expected)


def test_max_side(clip: Path, tmp_path: Path):
    expected = [resize_max_side(frame, 80) for frame in decoded(clip)]
    assert expected[0].shape == (60, 80)
    np.testing.assert_array_equal(one(clip, tmp_path, max_side=80), expected)
    for large in (160, 1000, None):
        np.testing.assert_array_equal(one(clip, tmp_path / str(large), max_side=large), decoded(clip))


def test_frames_are_copies_and_indexes_are_checked(clip: Path, tmp_path: Path):
    (shot,) = video(clip, tmp_path)
    shot.frame(0)[:] = 0
    np.testing.assert_array_equal(shot.frame(0), decoded(clip)[0])
    for index in (-1, 12):
        with pytest.raises(IndexError):
            shot.frame(index)


def test_a_moved_video_keeps_its_fingerprint(clip: Path, tmp_path: Path):
    moved = Path(shutil.copy2(clip, tmp_path / "moved.avi"))
    assert video(moved, tmp_path)[0].fingerprint == video(clip, tmp_path)[0].fingerprint


def test_shots_are_sequences(tmp_path: Path):
    lengths = [6, 4, 1, 5]
    frames = [
        frame for seed, length in enumerate(lengths) for frame in flight(length, size=(320, 240), seed=seed).frames
    ]
    path = write_video(tmp_path / "cuts.avi", frames)
    shots = video(path, tmp_path / "cache")
    assert [(shot.name, len(shot)) for shot in shots] == [("cuts_shot0", 6), ("cuts_shot1", 4), ("cuts_shot2", 5)]
    assert len({shot.fingerprint for shot in shots}) == 3
    direct = decoded(path)
    np.testing.assert_array_equal([frame for shot in shots for frame in frames_of(shot)], direct[:10] + direct[11:])


def test_no_shot_of_two_frames(tmp_path: Path):
    frames = [flight(1, size=(320, 240), seed=seed).frames[0] for seed in range(3)]
    with pytest.raises(BadInputError, match=r"slides\.avi has no shot of two frames"):
        video(write_video(tmp_path / "slides.avi", frames), tmp_path / "cache")


def test_folder_glob_and_list(clip: Path, tmp_path: Path):
    for name in ("b.avi", "a.AVI", "c.avi"):
        shutil.copy(clip, tmp_path / name)
    (tmp_path / "notes.txt").write_text("no video")
    (tmp_path / "._b.avi").write_text("what another system leaves behind")
    cache = tmp_path / "cache"
    assert [shot.name for shot in video(tmp_path, cache)] == ["a", "b", "c"]
    assert [shot.name for shot in video(f"{tmp_path}/*[bc].avi", cache)] == ["b", "c"]
    assert [shot.name for shot in video(f"{tmp_path.parent}/**/{tmp_path.name}/c*", cache)] == ["c"]
    assert [shot.name for shot in video([tmp_path / "c.avi", str(tmp_path)], cache)] == ["c", "a", "b"]


def test_a_name_that_looks_like_a_glob(clip: Path, tmp_path: Path):
    path = Path(shutil.copy(clip, tmp_path / "take[1]*.avi"))
    assert len(one(path, tmp_path / "cache")) == 12


def test_equal_names_in_two_folders(tmp_path: Path):
    paths = []
    for seed in range(3):
        folder = tmp_path / f"drive{seed}"
        folder.mkdir()
        paths.append(write_video(folder / "front.avi", flight(seed=seed).frames))
    shots = video([path.parent for path in paths], tmp_path / "cache")
    assert len({shot.name for shot in shots}) == 3
    assert shots[0].name == "front"
    for shot, path in zip(shots, paths, strict=True):
        np.testing.assert_array_equal(frames_of(shot), decoded(path))


@pytest.mark.parametrize("content", [b"", b"no video at all\n" * 500, b"RIFF\x00\x10\x00\x00AVI LIST"])
def test_not_a_video(tmp_path: Path, content: bytes):
    path = tmp_path / "broken.avi"
    path.write_bytes(content)
    with pytest.raises(BadInputError, match=r"broken\.avi has no frames that OpenCV can decode"):
        video(path, tmp_path / "cache")


def test_a_video_without_its_index(tmp_path: Path):
    whole = write_video(tmp_path / "whole.mp4", flight().frames, "mp4v").read_bytes()
    path = tmp_path / "half.mp4"
    path.write_bytes(whole[: len(whole) // 2])  # the index of an mp4 is at its end
    with pytest.raises(BadInputError, match=r"half\.mp4 has no frames"):
        video(path, tmp_path / "cache")


def test_half_an_avi_gives_its_frames(clip: Path, tmp_path: Path):
    path = tmp_path / "half.avi"
    path.write_bytes(clip.read_bytes()[: clip.stat().st_size // 2])
    expected = decoded(path)
    assert 2 <= len(expected) < 12
    np.testing.assert_array_equal(one(path, tmp_path / "cache"), expected)


def test_missing(tmp_path: Path):
    (tmp_path / "empty").mkdir()
    for path in (
        tmp_path / "gone.mp4",
        tmp_path / "empty",
        f"{tmp_path}/*.mp4",
        f"{tmp_path}/*",
        [tmp_path / "gone.mp4"],
    ):
        with pytest.raises(BadInputError, match="there is no video"):
            video(path, tmp_path / "cache")
    with pytest.raises(BadInputError, match="no shot"):
        video([], tmp_path / "cache")
    assert not (tmp_path / "cache").exists()


def test_one_frame(tmp_path: Path, clip: Path):
    path = write_video(tmp_path / "one.avi", flight(1).frames)
    with pytest.raises(BadInputError, match=r"one\.avi gives one frame only"):
        video(path, tmp_path / "cache")
    with pytest.raises(BadInputError, match=r"clip\.avi gives one frame only at data\.stride=12"):
        video(clip, tmp_path / "cache", stride=12)


@pytest.mark.parametrize(
    "parameters",
    [{"max_frames": 1}, {"max_frames": -1}, {"stride": 0}, {"stride": -2}, {"max_side": 0}, {"max_side": 15}],
)
def test_bad_parameters(clip: Path, tmp_path: Path, parameters: dict[str, int]):
    with pytest.raises(BadInputError, match=f"not .*{next(iter(parameters.values()))}"):
        video(clip, tmp_path, **parameters)


class Capture:
    """Wraps a capture, and tells a wrong number of frames."""

    def __init__(self, capture: cv2.VideoCapture, count: float) -> None:
        self.capture, self.count = capture, count

    def __getattr__(self, name: str) -> Any:
        return getattr(self.capture, name)

    def get(self, key: int) -> float:
        return self.count if key == cv2.CAP_PROP_FRAME_COUNT else self.capture.get(key)


@pytest.mark.parametrize("count", [0, -1, -9.2e18, 1, 5, 13, 9.2e18, float("nan")])
def test_a_wrong_number_of_frames_does_no_harm(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: float
):
    expected, original = decoded(clip), cv2.VideoCapture
    monkeypatch.setattr(cv2, "VideoCapture", lambda path: Capture(original(path), count))
    np.testing.assert_array_equal(one(clip, tmp_path), expected)


def test_size_that_changes(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    sizes = iter([(120, 160), (120, 160), (60, 80)])
    monkeypatch.setattr(video_module, "_next_frame", lambda *_: np.zeros(next(sizes), np.uint8))
    with pytest.raises(BadInputError, match=r"clip\.avi changes its size at frame 2"):
        video(clip, tmp_path)

import shutil
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from textured_scenes import flight, texture
from video_files import decoded, frames_of, one, write_video

from sips_lit.errors import BadInputError, InputWarning
from sips_lit.frames.images import resize_max_side
from sips_lit.frames.video import find_videos, video


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
    with pytest.raises(BadInputError, match=r"broken\.avi is no video that can be read"):
        video(path, tmp_path / "cache")


def test_a_video_without_its_index(tmp_path: Path):
    whole = write_video(tmp_path / "whole.mp4", flight().frames, "mp4v").read_bytes()
    path = tmp_path / "half.mp4"
    path.write_bytes(whole[: len(whole) // 2])  # the index of an mp4 is at its end
    with pytest.raises(BadInputError, match=r"half\.mp4 is no video that can be read"):
        video(path, tmp_path / "cache")


def test_half_an_avi_gives_its_whole_frames(clip: Path, tmp_path: Path):
    path = tmp_path / "half.avi"
    path.write_bytes(clip.read_bytes()[: clip.stat().st_size // 2])
    with pytest.warns(InputWarning, match=r"half\.avi is damaged: it ends early, after 5 frames"):
        frames = one(path, tmp_path / "cache")
    np.testing.assert_array_equal(frames, decoded(clip)[:5])
    with pytest.warns(InputWarning, match="ends early"):  # also from the cache
        (shot,) = video(path, tmp_path / "cache")
    assert shot.damage is not None
    assert video(clip, tmp_path / "cache")[0].damage is None


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


def test_max_frames_is_told(clip: Path, tmp_path: Path, recwarn: pytest.WarningsRecorder):
    one(clip, tmp_path, max_frames=12)
    one(clip, tmp_path, max_frames=6, stride=2)
    assert not recwarn.list
    with pytest.warns(InputWarning, match=r"clip\.avi is longer than data\.max_frames=11"):
        one(clip, tmp_path, max_frames=11)


def test_files_that_are_no_videos_are_named(clip: Path, tmp_path: Path):
    for name in ("a.avi", "b.MTS", ".c.avi", "a.lrv", "notes.txt"):
        shutil.copy(clip, tmp_path / name)
    with pytest.warns(InputWarning, match=r"2 files are no videos and are not read: a\.lrv, notes\.txt"):
        assert [file.name for file in find_videos(tmp_path)] == ["a.avi", "b.MTS"]


def resized(path: Path, sizes: Sequence[tuple[int, int]]) -> Path:
    """A raw stream of JPEG images, four of each size."""
    images = [cv2.resize(texture(240, 320), size, interpolation=cv2.INTER_AREA) for size in sizes for _ in range(4)]
    path.write_bytes(b"".join(cv2.imencode(".jpg", image)[1].tobytes() for image in images))
    return path


def test_a_size_that_changes_ends_a_shot(tmp_path: Path):
    shots = video(resized(tmp_path / "call.mjpeg", [(320, 240), (160, 120)]), tmp_path / "cache", max_side=160)
    assert [len(shot) for shot in shots] == [4, 4]
    assert {shot.frame(3).shape for shot in shots} == {(120, 160)}
    difference = shots[0].frame(0).astype(int) - shots[1].frame(0)
    assert np.abs(difference).mean() < 3


def test_a_shape_that_changes(tmp_path: Path):
    path = resized(tmp_path / "turned.mjpeg", [(320, 240), (240, 320)])
    with pytest.raises(BadInputError, match=r"turned\.mjpeg, frame 4, is 240x320, .* split the video there"):
        video(path, tmp_path / "cache")

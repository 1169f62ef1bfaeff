"""The frame cache of a video: resumed after a kill, never half, shared by processes."""

import errno
import json
import multiprocessing
import os
import pickle
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from textured_scenes import flight
from video_files import decoded, frames_of, one, write_video

from sips_lit.errors import BadInputError
from sips_lit.frames.span import Span
from sips_lit.frames.video import video
from sips_lit.frames.video_file import VideoFile
from sips_lit.frames.video_frame import VideoFrame
from sips_lit.types import GreyImage, ImageSequence


def cached(cache: Path) -> Path:
    (folder,) = cache.iterdir()
    return folder


class KilledError(Exception):
    """Stands for a kill in the middle of the decoding."""


def stop_after(monkeypatch: pytest.MonkeyPatch, count: int, error: BaseException) -> None:
    """Decoding ends with ``error`` after ``count`` frames."""
    grey, left = VideoFrame.grey, iter(range(count))

    def interrupted(frame: VideoFrame, span: Span) -> GreyImage:
        if next(left, None) is None:
            raise error
        return grey(frame, span)

    monkeypatch.setattr(VideoFrame, "grey", interrupted)


def test_second_open_decodes_nothing(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (first,) = video(clip, tmp_path)

    def refuse(*_: object) -> None:
        raise AssertionError("decoded again")

    monkeypatch.setattr(VideoFile, "__iter__", refuse)
    (again,) = video(clip, tmp_path)
    assert (again.name, again.fingerprint) == (first.name, first.fingerprint)
    np.testing.assert_array_equal(frames_of(again), frames_of(first))


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("kept", [0, 0.4, 1, 2.5, 5, 5.9])
def test_goes_on_after_a_kill(clip: Path, tmp_path: Path, kept: float, stride: int):
    expected = one(clip, tmp_path, stride=stride)
    folder = cached(tmp_path)
    (folder / "meta.json").unlink()
    os.truncate(folder / "frames.u8", int(kept * 160 * 120))
    np.testing.assert_array_equal(one(clip, tmp_path, stride=stride), expected)
    assert len(list(tmp_path.iterdir())) == 1


def test_goes_on_where_it_stopped(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with monkeypatch.context() as patch:
        stop_after(patch, 1 + 8, KilledError())  # the first one twice: it tells the size
        with pytest.raises(KilledError):
            video(clip, tmp_path)
    folder = cached(tmp_path)
    assert not (folder / "meta.json").exists()
    assert (folder / "frames.u8").stat().st_size == 8 * 160 * 120
    with monkeypatch.context() as patch:
        stop_after(patch, 1 + 4, AssertionError("decoded more than the first and the missing ones"))
        np.testing.assert_array_equal(one(clip, tmp_path), decoded(clip))


def test_bytes_of_a_damaged_cache_are_replaced(clip: Path, tmp_path: Path):
    expected = one(clip, tmp_path)
    with (cached(tmp_path) / "frames.u8").open("ab") as handle:
        handle.write(b"half a frame")
    np.testing.assert_array_equal(one(clip, tmp_path), expected)
    assert (cached(tmp_path) / "frames.u8").stat().st_size == 12 * 160 * 120


REST = '"damage": null, "more": false}'


@pytest.mark.parametrize(
    "text",
    [
        *("", "{", "[]", "3", "[" * 100_000, '{"shape": null}', '{"shape": [12, 120, 160]}'),
        '{"shape": [Infinity, 120, 160], "cuts": [], ' + REST,
        '{"shape": [12.0, 120, 160], "cuts": [], ' + REST,
        '{"shape": [12, 120, 160], "cuts": ["3"], ' + REST,
        '{"shape": [12, 120, 160], "cuts": [5, 99], ' + REST,
    ],
)
def test_a_damaged_description_is_made_anew(clip: Path, tmp_path: Path, text: str):
    expected = one(clip, tmp_path)
    meta = cached(tmp_path) / "meta.json"
    whole = meta.read_text()
    meta.write_text(text)
    np.testing.assert_array_equal(one(clip, tmp_path), expected)
    assert json.loads(meta.read_text()) == json.loads(whole)


def test_two_runs_may_decode_at_the_same_time(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    expected = decoded(clip)
    frames_left = VideoFile.__iter__
    others: list[list[GreyImage]] = []

    def with_another_run(source: VideoFile) -> Iterator[VideoFrame]:
        for index, frame in enumerate(frames_left(source)):
            if index == 5 and not others:
                others.append([])
                others[0] += one(clip, tmp_path)
            yield frame

    monkeypatch.setattr(VideoFile, "__iter__", with_another_run)
    np.testing.assert_array_equal(one(clip, tmp_path), expected)
    np.testing.assert_array_equal(others[0], expected)
    np.testing.assert_array_equal(one(clip, tmp_path), expected)


def test_another_parameter_or_source_has_another_cache(tmp_path: Path):
    path = write_video(tmp_path / "a.avi", flight().frames)
    cache = tmp_path / "cache"
    fingerprints = []
    for parameters in ({}, {"stride": 2}, {"max_frames": 7}, {"max_side": 80}):
        fingerprints += [shot.fingerprint for shot in video(path, cache, **parameters)]
    assert [shot.fingerprint for shot in video(path, cache)] == fingerprints[:1]
    write_video(path, flight(seed=1).frames)
    fingerprints += [shot.fingerprint for shot in video(path, cache)]
    np.testing.assert_array_equal(one(path, cache), decoded(path))
    os.utime(path, (0, 0))  # written again, say, with other frames in as many bytes
    fingerprints += [shot.fingerprint for shot in video(path, cache)]
    assert len(set(fingerprints)) == len(list(cache.iterdir())) == 6


def test_too_little_space(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 10**9, 10**6))
        with pytest.raises(BadInputError, match=r"clip\.avi need 0\.0 GB in .* where 0\.0 GB are free"):
            video(clip, tmp_path)
    assert len(one(clip, tmp_path)) == 12


def test_disk_that_gets_full(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with monkeypatch.context() as patch:
        stop_after(patch, 1 + 7, OSError(errno.ENOSPC, "No space left on device"))
        with pytest.raises(
            BadInputError, match=r"cannot write the frames of .*clip\.avi to .*No space left .*run it again"
        ):
            video(clip, tmp_path)
    assert (cached(tmp_path) / "frames.u8").stat().st_size == 7 * 160 * 120
    np.testing.assert_array_equal(one(clip, tmp_path), decoded(clip))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_device_that_is_full(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    opened = Path.open
    with monkeypatch.context() as patch:
        full = lambda path, *mode: opened(Path("/dev/full") if path.name == "frames.u8" else path, *mode)  # noqa: E731
        patch.setattr(Path, "open", full)
        with pytest.raises(BadInputError, match="No space left on device"):
            video(clip, tmp_path)
    np.testing.assert_array_equal(one(clip, tmp_path), decoded(clip))


def test_cache_that_cannot_be_made(clip: Path, tmp_path: Path):
    (tmp_path / "cache").write_text("a file")
    with pytest.raises(BadInputError, match="cannot write the frames"):
        video(clip, tmp_path / "cache")


def test_cache_deleted_while_open(clip: Path, tmp_path: Path):
    (shot,) = video(clip, tmp_path)
    other = pickle.loads(pickle.dumps(shot))
    shutil.rmtree(cached(tmp_path))
    for _ in range(2):
        with pytest.raises(BadInputError, match=r"frame cache .* is gone or damaged: run again"):
            other.frame(0)


def test_cache_shortened_while_open(clip: Path, tmp_path: Path):
    (shot,) = video(clip, tmp_path)
    os.truncate(cached(tmp_path) / "frames.u8", 100)
    with pytest.raises(BadInputError, match="is gone or damaged"):
        shot.frame(0)


def checksum(shot: ImageSequence, index: int) -> int:
    return int(shot.frame(index).sum())


def test_another_process_reads_the_file_itself(clip: Path, tmp_path: Path):
    (shot,) = video(clip, tmp_path)
    expected = [checksum(shot, i) for i in range(12)]
    assert len(pickle.dumps(shot)) < 2000
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.starmap(checksum, [(shot, i) for i in range(12)]) == expected

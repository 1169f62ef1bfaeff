"""What sips-train makes of frames that can't be read."""

import re

import cv2
import pytest
from cli_runs import TINY, write_frames
from textured_scenes import flight
from video_files import write_video

from sips_lit.errors import BadInputError
from sips_lit.frames.folder import FolderSequence


def given(frames, *more: str) -> list[str]:
    return [*TINY, "data=folder", f"data.path={frames}", *more]


def test_a_damaged_image_in_the_middle_is_left_out(command, tmp_path):
    folder = write_frames(tmp_path / "frames", flight(16, size=(96, 80)).frames)
    (folder / "005.png").write_bytes((folder / "005.png").read_bytes()[:200])
    result = command("train", *given(folder))
    assert result.code == 0, result.err
    warned = [line for line in result.err.splitlines() if line.startswith("warning: ")]
    assert len(warned) == 1
    assert "frames of the training data can't be read and are left out (1)" in warned[0]
    assert f"{folder}/005.png is not an image" in warned[0]


@pytest.mark.parametrize("loading", [0, 1])
def test_pairs_that_turn_out_damaged_are_left_out_and_counted(command, tmp_path, loading, monkeypatch):
    folder = write_frames(tmp_path / "frames", flight(16, size=(96, 80)).frames)
    read = FolderSequence.frame

    def from_now_on(sequence, index):
        if index == 5:
            raise BadInputError("005.png is damaged")
        return read(sequence, index)

    assert command("index", "data=folder", f"data.path={folder}").code == 0
    monkeypatch.setattr(FolderSequence, "frame", from_now_on)
    result = command("train", *given(folder, f"datamodule.loading_workers={loading}", "trainer.max_steps=12"))
    assert result.code == 0, result.err
    warned = [line for line in result.err.splitlines() if line.startswith("warning: ")]
    assert warned[0] == "warning: a training pair is left out, and others may be: 005.png is damaged"
    assert re.fullmatch(r"warning: \d+ training pairs were left out; the first: 005\.png is damaged", warned[1])


def test_images_of_several_sizes_in_one_folder(command, tmp_path):
    frames = flight(16, size=(96, 80)).frames
    folder = write_frames(tmp_path / "mixed", [*frames[:7], cv2.resize(frames[7], (60, 50)), *frames[8:]])
    result = command("train", *given(folder))
    assert result.code == 0, result.err
    assert "007.png is 60x50" in result.err
    half = write_frames(tmp_path / "half", [*frames[:8], *(cv2.resize(frame, (60, 50)) for frame in frames[8:])])
    assert "half of the frames of half can't be read; the first of them: " in (
        sentence := command("train", *given(half)).sentence
    )
    assert "008.png is 60x50" in sentence


def test_a_broken_video_among_many_costs_one_line(command, tmp_path):
    videos = tmp_path / "videos"
    videos.mkdir()
    for name in ("a", "b"):
        write_video(videos / f"{name}.avi", flight(16, size=(96, 80), name=name).frames)
    (videos / "broken.avi").write_bytes(b"no video at all" * 100)
    given = "data=video", f"data.path={videos}"
    result = command("train", *TINY, *given)
    assert result.code == 0, result.err
    warned = [line for line in result.err.splitlines() if line.startswith("warning: ")]
    assert warned == [line for line in warned if line.startswith(f"warning: left out: {videos}/broken.avi is no video")]
    assert len(warned) == 1
    evaluation = command("evaluate", "detector=fast", *given, "checkpoint=none")
    assert f"an evaluation needs every recording: left out: {videos}/broken.avi is no video" in evaluation.sentence

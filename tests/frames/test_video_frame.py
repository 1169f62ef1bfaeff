"""Frames upright, whatever the file says of the camera."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from textured_scenes import flight
from video_files import write_video

from sips_lit.frames.video_file import VideoFile

MATRICES = {  # of a track, and what it does to an image
    (0, 1, -1, 0): lambda image: cv2.rotate(image, cv2.ROTATE_90_CLOCKWISE),
    (-1, 0, 0, -1): lambda image: cv2.rotate(image, cv2.ROTATE_180),
    (0, -1, 1, 0): lambda image: cv2.rotate(image, cv2.ROTATE_90_COUNTERCLOCKWISE),
    (-1, 0, 0, 1): lambda image: cv2.flip(image, 1),
    (1, 0, 0, -1): lambda image: cv2.flip(image, 0),
    (0, 1, 1, 0): lambda image: cv2.transpose(image),
}


@pytest.fixture(scope="module")
def upright(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_video(tmp_path_factory.mktemp("upright") / "whole.mp4", flight(2, size=(320, 240)).frames, "mp4v")


@pytest.mark.parametrize("matrix", MATRICES, ids=str)
def test_turned_and_mirrored(upright: Path, tmp_path: Path, matrix: tuple[int, int, int, int]):
    a, b, c, d = matrix
    data = bytearray(upright.read_bytes())
    struct.pack_into(">9i", data, data.index(b"tkhd") + 44, a << 16, b << 16, 0, c << 16, d << 16, 0, 0, 0, 1 << 30)
    (tmp_path / "turned.mp4").write_bytes(data)
    frame = next(iter(VideoFile(tmp_path / "turned.mp4")))
    wanted = MATRICES[matrix](next(iter(VideoFile(upright))).colour())
    np.testing.assert_array_equal(frame.colour(), wanted)
    assert frame.size == wanted.shape[1::-1]


@pytest.mark.shared_data
def test_a_portrait_stands_upright(shared_cases: Path):
    frames = [frame.colour() for frame in VideoFile(shared_cases / "rot.mp4")]
    capture = cv2.VideoCapture(str(shared_cases / "rot.mp4"))
    assert frames[0].shape == (240, 320, 3)
    np.testing.assert_array_equal(frames[0], capture.read()[1])
    assert next(iter(VideoFile(shared_cases / "rot.mp4"))).size == (320, 240)

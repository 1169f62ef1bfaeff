from pathlib import Path

import pytest
from textured_scenes import flight
from video_files import write_video

from sips_lit.frames.footage import SAMPLE, Footage, footage_of_all, footage_of_video
from sips_lit.frames.video import video


@pytest.fixture(scope="module")
def clip(tmp_path_factory) -> Path:
    """12 frames at 10 a second, 96x80."""
    return write_video(tmp_path_factory.mktemp("clip") / "a.avi", flight(12, size=(96, 80)).frames)


@pytest.mark.filterwarnings("ignore::sips_lit.errors.InputWarning")
@pytest.mark.parametrize(
    ("max_side", "max_frames", "stride"), [(None, 100, 1), (48, 100, 1), (None, 7, 1), (None, 100, 5), (40, 2, 3)]
)
def test_the_frame_cache_has_as_many_bytes(clip, tmp_path, max_side, max_frames, stride):
    footage = footage_of_video(clip, max_side, max_frames, stride)
    assert footage is not None
    assert footage.hours == pytest.approx(1.2 / 3600)
    (shot,) = video(clip, tmp_path, max_side, max_frames, stride)
    assert footage.bytes == sum(path.stat().st_size for path in tmp_path.rglob("frames.u8"))
    assert footage.bytes == len(shot) * shot.frame(0).size


@pytest.mark.filterwarnings("ignore::sips_lit.errors.InputWarning")
def test_recordings_tell_what_is_there(clip, tmp_path):
    (recording,) = video.recordings(clip, tmp_path, max_frames=5)
    before = recording.footage()
    recording.open()
    after = recording.footage()
    assert before == Footage(1.2 / 3600, 5 * 96 * 80, 0)
    assert after == Footage(1.2 / 3600, 5 * 96 * 80, 5 * 96 * 80)


def test_a_file_that_is_no_video(tmp_path):
    path = tmp_path / "broken.avi"
    path.write_bytes(b"no video at all" * 100)
    assert footage_of_video(path, None, 100, 1) is None
    assert footage_of_video(tmp_path / "gone.avi", None, 100, 1) is None


def test_few_are_added_and_unknown_ones_passed_over():
    parts = [Footage(1, 300, 100), None, Footage(3, 100, 0)]
    total = footage_of_all([lambda part=part: part for part in parts])
    assert total == Footage(4, 400, 100)
    assert total.per_hour == 100
    assert footage_of_all([lambda: None]) is None
    assert footage_of_all([]) is None


def test_many_are_told_from_a_sample():
    asked = []

    def head(at: int) -> Footage:
        asked.append(at)
        return Footage(2, 10 if at % 2 else 30, 0)

    total = footage_of_all([lambda at=at: head(at) for at in range(9999)])
    assert total is not None
    assert (len(asked), min(asked), max(asked)) == (SAMPLE, 0, 9998)
    assert total.hours == pytest.approx(2 * 9999)
    assert total.bytes == pytest.approx(20 * 9999, rel=0.15)


def test_in_words():
    assert str(Footage(12.34, 3.1e12, 0)) == (
        "about 12.3 hours of video: 3.1 TB of frames (251.2 GB an hour of video), of which 0.0 MB are there"
    )
    assert str(Footage(0.02, 4e6, 1e6)).startswith("about 1.2 minutes of video: 4.0 MB of frames (200.0 MB an hour")

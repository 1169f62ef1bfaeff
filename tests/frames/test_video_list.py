import os
from pathlib import Path

import pytest
from textured_scenes import flight
from video_files import write_video

from sips_lit.errors import BadInputError
from sips_lit.frames.video import find_videos, video


@pytest.fixture
def videos(tmp_path: Path) -> Path:
    """Two videos in a folder, a third in a folder below."""
    (tmp_path / "videos" / "more").mkdir(parents=True)
    for name in ("b", "a", "more/a"):
        write_video(tmp_path / "videos" / f"{name}.avi", flight(3, size=(64, 48)).frames)
    return tmp_path / "videos"


def listed(folder: Path, *lines: str) -> Path:
    path = folder / "list.txt"
    path.write_text("\n".join(lines))
    return path


def test_a_list_names_files_folders_and_globs_relative_to_itself(videos, monkeypatch):
    monkeypatch.chdir("/")
    path = listed(videos, "# chosen by hand", "b.avi", "", "  more  ", "*.avi", f"{videos}/a.avi")
    assert find_videos(path) == [videos / n for n in ("b.avi", "more/a.avi", "a.avi", "b.avi", "a.avi")]
    assert [shot.name for shot in video(path, videos / "cache")][:2] == ["b", "a"]
    assert len(video(path, videos / "cache")) == 3  # each once


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        (("a.avi", "gone.avi"), r"there is no video .*/videos/gone\.avi"),
        (("# nothing",), r"there is no video .*list\.txt"),
        (("a" * 300,), r"list\.txt names a+, which can't be a file"),
        (("a\0.avi",), r"list\.txt names a.x00\.avi, which can't be a file"),
        (("list.txt",), r"list\.txt names another list"),
    ],
)
def test_wrong_lists(videos, lines, sentence):
    with pytest.raises(BadInputError, match=sentence):
        find_videos(listed(videos, *lines))


def test_a_list_that_is_no_text(videos):
    (videos / "list.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadInputError, match=r"cannot read .*list\.txt as a list of videos"):
        find_videos(videos / "list.txt")


def test_nothing_is_decoded_before_it_is_asked_for(videos, tmp_path):
    recordings = video.recordings(videos / "**" / "*.avi", tmp_path / "cache")
    assert not (tmp_path / "cache").exists()
    assert [Path(recording.where) for recording in recordings] == [videos / n for n in ("a.avi", "b.avi", "more/a.avi")]
    (shot,) = recordings[1].open()
    assert [folder.name[:2] for folder in (tmp_path / "cache").iterdir()] == ["b-"]
    eager = video(videos / "**" / "*.avi", tmp_path / "cache")
    assert (eager[1].name, eager[1].fingerprint) == (shot.name, shot.fingerprint)
    assert [shot.name for recording in recordings for shot in recording.open()] == [shot.name for shot in eager]
    assert len({shot.name for shot in eager}) == 3


def test_many_videos_keep_no_file_open(videos, tmp_path):
    shots = video(videos / "**" / "*.avi", tmp_path / "cache")
    for shot in shots:
        shot.frame(1)
    opened = Path("/proc/self/fd")
    if not opened.is_dir():
        pytest.skip("only Linux tells which files are open")
    assert not [fd for fd in opened.iterdir() if "frames.u8" in os.path.realpath(fd)]
    assert "frames.u8" not in Path("/proc/self/maps").read_text()

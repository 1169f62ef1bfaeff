import pytest

from sips_lit.datasets.videos import SPEC


@pytest.mark.parametrize(
    ("files", "sign"),
    [
        (["a.mp4"], "1 video"),
        (["a.MP4", "b.avi", "c.txt"], "2 videos"),
        ([".a.mp4", "c.txt"], None),
        (["more/a.mp4"], None),
        ([], None),
    ],
)
def test_visible_videos_of_a_folder(tmp_path, files, sign):
    for name in files:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert SPEC.sign(tmp_path) == sign


def test_a_file(tmp_path):
    for name in ("a.mkv", "list.txt"):
        (tmp_path / name).touch()
    assert SPEC.sign(tmp_path / "a.mkv") == "a.mkv"
    assert SPEC.sign(tmp_path / "list.txt") is None

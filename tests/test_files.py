import csv
import re
import threading
from pathlib import Path

import pytest

from sips_lit.errors import BadInputError
from sips_lit.files import Unfinished, disk_of, make_folder, write_csv, write_whole


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_content_is_written_and_replaced(tmp_path):
    path = tmp_path / "points.npz"
    write_whole(path, b"one")
    assert path.read_bytes() == b"one"
    write_whole(path, b"")
    assert path.read_bytes() == b""
    assert names(tmp_path) == ["points.npz"]


def test_what_cannot_be_written_leaves_no_trace(tmp_path):
    target = tmp_path / "taken"
    target.mkdir()
    (target / "inside").touch()
    with pytest.raises(BadInputError, match=r"cannot write .*taken \(.*\): free some space, or write elsewhere"):
        write_whole(target, b"content")
    assert names(tmp_path) == ["taken"]
    with pytest.raises(BadInputError, match="No such file"):
        write_whole(tmp_path / "gone" / "file", b"content")


def test_a_failed_write_keeps_the_old_content(tmp_path, monkeypatch):
    path = tmp_path / "file"
    write_whole(path, b"old")

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    disk = re.escape(str(disk_of(tmp_path)))
    with pytest.raises(
        BadInputError, match=rf"cannot write {path}: the disk {disk} is full \(No space left on device\)"
    ):
        write_whole(path, b"new")
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == ["file"]


def test_ctrl_c_leaves_nothing_half_written(tmp_path, monkeypatch):
    path = tmp_path / "file"
    write_whole(path, b"old")

    def interrupted(handle: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_whole(path, b"new")
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == ["file"]


def test_a_disk_that_is_really_full(full_disk):
    write_whole(full_disk / "file", b"a" * 200_000)
    with pytest.raises(BadInputError, match=f"the disk {full_disk} is full"):
        write_whole(full_disk / "file", b"b" * 2_000_000)
    assert (full_disk / "file").read_bytes() == b"a" * 200_000
    assert names(full_disk) == ["file"]


def test_the_disk_of_a_path_is_that_of_the_folder_it_will_be_in(tmp_path):
    assert disk_of(Path("/")) == Path("/")
    shm = Path("/dev/shm")
    if not shm.is_mount():
        pytest.skip("needs /dev/shm")
    assert disk_of(shm / "not" / "there" / "yet") == shm
    (tmp_path / "link").symlink_to(shm)
    assert disk_of(tmp_path / "link" / "run") == shm


def test_readers_see_whole_files_only(tmp_path):
    path, contents = tmp_path / "file", (b"a" * 300_000, b"b" * 300_000)
    write_whole(path, contents[0])
    seen, stop = set(), threading.Event()

    def read() -> None:
        while not stop.is_set():
            seen.add(path.read_bytes())

    reader = threading.Thread(target=read)
    reader.start()
    for turn in range(20):
        write_whole(path, contents[turn % 2])
    stop.set()
    reader.join()
    assert seen <= set(contents)


def test_folders_with_those_above_them(tmp_path):
    make_folder(tmp_path / "a" / "b")
    make_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").touch()
    for path in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(BadInputError, match=r"cannot make the folder .*: choose another place"):
            make_folder(path)


def test_a_table_reads_back(tmp_path):
    rows = [("name", "a number", "nothing"), ('said "no", then left', 0.1 + 0.2, None), ("ü\nnew line", -1, "")]
    write_csv(tmp_path / "table.csv", rows)
    with (tmp_path / "table.csv").open(newline="", encoding="utf-8") as file:
        read = list(csv.reader(file))
    assert read == [[*rows[0]], [rows[1][0], "0.30000000000000004", ""], [rows[2][0], "-1", ""]]
    assert float(read[1][1]) == rows[1][1]


def test_an_unfinished_file_gets_its_name_when_it_is_whole(tmp_path):
    whole = Unfinished(tmp_path / "new" / "a.db")
    whole.temporary.write_text("half")
    assert not whole.path.exists()
    whole.finish()
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.db"]
    whole.temporary.write_text("other")
    whole.discard()
    whole.discard()
    assert whole.path.read_text() == "half"
    with pytest.raises(BadInputError, match=r"cannot write .*a\.db"):
        whole.finish()
    with pytest.raises(BadInputError, match="which is a folder"):
        Unfinished(tmp_path / "new")

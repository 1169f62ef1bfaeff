import multiprocessing
import os
import pickle
import tracemalloc
import zipfile
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from textured_scenes import texture

from sips_lit.archives import zip_members
from sips_lit.archives.zip_members import OPEN_ARCHIVES, read_member
from sips_lit.errors import BadInputError
from sips_lit.frames.zip_images import ZipSequence, list_images


def encoded(image: np.ndarray, suffix: str = ".jpg") -> bytes:
    return cv2.imencode(suffix, image)[1].tobytes()


def write_zip(path: Path, count: int = 4, packed: int = zipfile.ZIP_STORED, name: str = "{:05d}.jpg") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", packed) as archive:
        for i in range(count):
            archive.writestr(name.format(i), encoded(texture(48, 64, i), Path(name).suffix))
    return path


@pytest.mark.parametrize("packed", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
@pytest.mark.parametrize("name", ["{:05d}.jpg", "images/{}.png", "./{}.PNG"])
def test_frames_in_order_as_from_files(tmp_path: Path, packed: int, name: str):
    sequence = ZipSequence(write_zip(tmp_path / "images.zip", 12, packed, name))
    assert len(sequence) == 12
    for i in range(12):
        expected = cv2.imdecode(np.frombuffer(encoded(texture(48, 64, i), Path(name).suffix), np.uint8), 0)
        np.testing.assert_array_equal(sequence.frame(i), expected)
        assert int(sequence.frame_name(i)) == i
    assert sorted(file.name for file in tmp_path.iterdir()) == ["images.zip"]  # nothing is unpacked


def test_bytes_as_they_were_written(tmp_path: Path):
    path = write_zip(tmp_path / "a.zip", 3, zipfile.ZIP_DEFLATED)
    with zipfile.ZipFile(path, "a") as archive:
        entry = zipfile.ZipInfo("more.jpg")
        entry.extra = b"\x99\x99\x04\x00abcd"  # a field of a kind that nobody knows, before the data
        archive.writestr(entry, encoded(texture(48, 64)))
    path.write_bytes(b"a program before the archive" + path.read_bytes())
    expected = [encoded(texture(48, 64, i)) for i in (0, 1, 2)] + [encoded(texture(48, 64))]
    assert [read_member(path, member) for member in list_images(path)] == expected


def test_few_archives_stay_open(tmp_path: Path, monkeypatch):
    def open_here() -> int:
        links = [file.readlink() for file in Path("/proc/self/fd").iterdir() if file.is_symlink()]
        return sum(str(link).startswith(str(tmp_path)) for link in links)

    monkeypatch.setattr(zip_members, "_opened", lru_cache(5)(zip_members._opened.__wrapped__))
    assert 50 <= OPEN_ARCHIVES <= 128  # all of TUM mono; far from the usual limit of 1024 open files
    sequences = [ZipSequence(write_zip(tmp_path / f"{i}.zip", 2)) for i in range(12)]
    assert open_here() == 0  # until a frame is read
    for sequence in sequences * 2:
        np.testing.assert_array_equal(sequence.frame(1), sequences[0].frame(1))
        assert 1 <= open_here() <= 5


def test_an_archive_that_was_replaced_is_opened_anew(tmp_path: Path):
    path = write_zip(tmp_path / "a.zip")
    ZipSequence(path).frame(0)
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        for i in range(2):
            archive.writestr(f"{i}.png", encoded(texture(48, 64, 7 + i), ".png"))
    (tmp_path / "b.zip").replace(path)
    np.testing.assert_array_equal(ZipSequence(path).frame(0), texture(48, 64, 7))


def test_workers_and_their_parent_read_one_large_archive_at_once(tmp_path: Path):
    """The archive is open in the parent before the fork; every picture has its own grey value."""
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for i in range(200):
            archive.writestr(f"{i}.png", encoded(np.full((200, 300), i, np.uint8), ".bmp"))
    sequence = ZipSequence(tmp_path / "a.zip")
    assert sequence.frame(0).max() == 0
    indices = list(range(200)) * 3
    with ProcessPoolExecutor(2, multiprocessing.get_context("fork")) as processes:
        futures = [processes.submit(grey_value, sequence, i) for i in indices]
        with ThreadPoolExecutor(2) as threads:
            assert list(threads.map(lambda i: grey_value(sequence, i), indices)) == indices
        assert [future.result() for future in futures] == indices


def grey_value(sequence: ZipSequence, index: int) -> int:
    (value,) = np.unique(sequence.frame(index))
    return int(value)


def test_members_written_to_a_pipe(tmp_path: Path):
    """Their headers leave sizes and checksum to a record behind the data; only the table of contents has them."""
    with (tmp_path / "a.zip").open("wb") as file:
        file.seekable = lambda: False  # type: ignore[method-assign] # as a pipe would say
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for i in range(3):
                archive.writestr(f"{i}.png", encoded(texture(48, 64, i), ".png"))
    np.testing.assert_array_equal(ZipSequence(tmp_path / "a.zip").frame(2), texture(48, 64, 2))


def test_what_is_no_image_is_passed_over(tmp_path: Path):
    path = write_zip(tmp_path / "a.zip")
    with zipfile.ZipFile(path, "a") as archive:
        archive.mkdir("more")
        archive.writestr(zipfile.ZipInfo("\0"), b"without a name")
        for name in ("notes.txt", "__MACOSX/._00000.jpg", ".hidden/1.jpg", "more/.x.jpg"):
            archive.writestr(name, b"no image")
    assert [member.filename for member in list_images(path)] == [f"{i:05d}.jpg" for i in range(4)]


def test_max_side_and_fingerprint(tmp_path: Path):
    path = write_zip(tmp_path / "a.zip")
    original = ZipSequence(path)
    assert ZipSequence(path, max_side=32).frame(0).shape == (24, 32)
    os.utime(path, ns=(0, 0))
    assert ZipSequence(path).fingerprint == original.fingerprint
    again = write_zip(tmp_path / "b.zip", packed=zipfile.ZIP_DEFLATED)
    assert ZipSequence(again).fingerprint == original.fingerprint  # the same images, packed in another way
    others = [ZipSequence(path, 32), ZipSequence(write_zip(tmp_path / "c.zip", 3))]
    others += [ZipSequence(write_zip(tmp_path / "d.zip", name="{:04d}.jpg"))]
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("00004.jpg", encoded(texture(48, 64, 9)))
    assert len({original.fingerprint, *(other.fingerprint for other in others), ZipSequence(path).fingerprint}) == 5


def test_threads_and_processes_read_at_once(tmp_path: Path):
    sequence = ZipSequence(write_zip(tmp_path / "a.zip", 12, zipfile.ZIP_DEFLATED))
    indices = [i % 12 for i in range(48)]
    expected = [sequence.frame(i) for i in indices]
    with ThreadPoolExecutor(8) as threads:
        np.testing.assert_array_equal(list(threads.map(sequence.frame, indices)), expected)
    with ProcessPoolExecutor(2, multiprocessing.get_context("fork")) as processes:
        np.testing.assert_array_equal(list(processes.map(sequence.frame, indices)), expected)
    other = pickle.loads(pickle.dumps(sequence))
    np.testing.assert_array_equal(other.frame(7), sequence.frame(7))
    assert (other.name, other.fingerprint) == (sequence.name, sequence.fingerprint)


@pytest.mark.parametrize("packed", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_damaged_member_is_named(tmp_path: Path, packed: int):
    path = write_zip(tmp_path / "a.zip", packed=packed)
    member = list_images(path)[2]
    data = bytearray(path.read_bytes())
    data[member.header_offset + 30 + len(member.filename) + member.compress_size // 2] ^= (
        0x10  # one bit in the middle of the picture
    )
    path.write_bytes(data)
    sequence = ZipSequence(path)
    sequence.frame(1)
    with pytest.raises(BadInputError, match=r"00002\.jpg in .*a\.zip is damaged: download"):
        sequence.frame(2)


def test_an_archive_that_shrank_or_went(tmp_path: Path):
    path = write_zip(tmp_path / "a.zip")
    sequence = ZipSequence(path)
    path.write_bytes(path.read_bytes()[:100])
    for index in (0, 3):
        with pytest.raises(BadInputError, match=rf"0000{index}\.jpg in .*a\.zip is damaged"):
            sequence.frame(index)
    path.unlink()
    with pytest.raises(BadInputError, match=r"cannot read the archive .*a\.zip: No such file"):
        sequence.frame(0)


def test_what_is_no_picture_and_another_size(tmp_path: Path):
    path = write_zip(tmp_path / "a.zip")
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("00004.jpg", b"text")
        archive.writestr("00005.jpg", encoded(texture(64, 48)))
    sequence = ZipSequence(path)
    with pytest.raises(BadInputError, match=r"00004\.jpg in .*a\.zip is not an image"):
        sequence.frame(4)
    with pytest.raises(BadInputError, match=r"00005\.jpg in .* is 48x64, but the first image is 64x48"):
        sequence.frame(5)


def test_truncated_empty_or_no_archive(tmp_path: Path):
    path = write_zip(tmp_path / "a.zip")
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(BadInputError, match=r"a\.zip is not a zip archive, or is truncated: .*get it again"):
        ZipSequence(path)
    for count, words in ((0, "has no image:"), (1, "has one image:")):
        with pytest.raises(BadInputError, match=words):
            ZipSequence(write_zip(tmp_path / "few.zip", count))
    (tmp_path / "zero.zip").touch()
    with pytest.raises(BadInputError, match="not a zip archive"):
        ZipSequence(tmp_path / "zero.zip")
    with pytest.raises(BadInputError, match="cannot read the archive"):
        ZipSequence(tmp_path / "gone.zip")


@pytest.mark.parametrize("name", ["../evil.jpg", "a/../../evil.jpg", "/tmp/evil.jpg", "..\\evil.jpg", "C:\\evil.jpg"])
def test_names_that_leave_the_folder_are_refused(tmp_path: Path, name: str):
    path = write_zip(tmp_path / "in" / "a.zip")
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(name, encoded(texture(48, 64)))
    with pytest.raises(BadInputError, match="which leaves the folder"):
        ZipSequence(path)
    assert [file.name for file in tmp_path.rglob("*")] == ["in", "a.zip"]


def test_encrypted_and_strangely_packed(tmp_path: Path):
    path = write_zip(tmp_path / "a.zip", packed=zipfile.ZIP_BZIP2)
    with pytest.raises(BadInputError, match=r"00000\.jpg in .* method other than deflate: unpack"):
        ZipSequence(path)
    path = write_zip(tmp_path / "b.zip")
    data = path.read_bytes()
    table = data.index(b"PK\x01\x02")
    path.write_bytes(data[: table + 8] + b"\x01" + data[table + 9 :])
    with pytest.raises(BadInputError, match=r"00000\.jpg in .* is encrypted: unpack"):
        ZipSequence(path)


def claim(path: Path, size: int) -> None:
    """Writes another unpacked size of the first member into the table of contents."""
    data = path.read_bytes()
    place = data.index(b"PK\x01\x02") + 24
    path.write_bytes(data[:place] + size.to_bytes(4, "little") + data[place + 4 :])


def test_members_that_lie_about_their_size(tmp_path: Path):
    path = tmp_path / "bomb.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("0.png", bytes(50_000_000))
        archive.writestr("1.png", bytes(100))
    claim(path, 1000)
    sequence = ZipSequence(path)
    tracemalloc.start()
    with pytest.raises(BadInputError, match=r"0\.png in .*bomb\.zip is damaged"):
        sequence.frame(0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 5_000_000  # it never grew to what it holds
    claim(path, 3_000_000_000)
    with pytest.raises(BadInputError, match=r"0\.png in .* claims 3000000000 bytes"):
        ZipSequence(path)
    claim(path, 50_000_001)
    with pytest.raises(BadInputError, match=r"0\.png in .*bomb\.zip is damaged"):
        ZipSequence(path).frame(0)


def test_names_longer_than_those_of_files(tmp_path: Path):
    path = write_zip(tmp_path / "a.zip", name="9" * 5000 + "{}.jpg")
    with pytest.raises(BadInputError, match="longer than that of any file"):
        ZipSequence(path)

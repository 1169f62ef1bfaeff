import zipfile
from pathlib import Path

import pytest

from sips_lit.archives.zip_members import LARGEST, check_member, list_members, read_member
from sips_lit.errors import BadInputError


def write(path: Path, packed: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", packed) as archive:
        archive.mkdir("folder")
        archive.writestr("folder/a.txt", b"a text " * 50)
    return path


def test_members_and_their_bytes(tmp_path: Path):
    path = write(tmp_path / "a.zip")
    folder, text = list_members(path)
    assert (folder.is_dir(), text.filename) == (True, "folder/a.txt")
    assert read_member(path, text) == b"a text " * 50


def test_what_is_no_archive(tmp_path: Path):
    (tmp_path / "a.zip").write_bytes(b"nothing")
    with pytest.raises(BadInputError, match=r"a\.zip is not a box of things, or is truncated"):
        list_members(tmp_path / "a.zip", "a box of things")
    with pytest.raises(BadInputError, match=r"cannot read the archive .*b\.zip: No such file"):
        list_members(tmp_path / "b.zip")


def test_members_that_can_not_be_read(tmp_path: Path):
    path = write(tmp_path / "a.zip", zipfile.ZIP_LZMA)
    member = list_members(path)[1]
    with pytest.raises(BadInputError, match=r"a\.txt in .* method other than deflate: pack it anew"):
        check_member(path, member, "pack it anew")
    member.compress_type, member.flag_bits = zipfile.ZIP_DEFLATED, 1
    with pytest.raises(BadInputError, match="is encrypted: pack it anew"):
        check_member(path, member, "pack it anew")
    member.flag_bits, member.file_size = 0, LARGEST + 1
    with pytest.raises(BadInputError, match=r"a\.txt in .* claims 268435457 bytes"):
        check_member(path, member, "")


def test_a_large_member_of_a_larger_archive_is_no_bomb(tmp_path: Path):
    path = write(tmp_path / "a.zip")
    member = list_members(path)[1]
    member.file_size = member.compress_size = LARGEST + 1
    with path.open("r+b") as file:
        file.truncate(LARGEST + 1000)  # sparse: no place on the disk
    check_member(path, member, "")


def test_every_damaged_byte_is_noticed_or_changes_nothing(tmp_path: Path):
    """zlib, the unpacker and zipfile itself each have errors of their own for it."""
    path = write(tmp_path / "a.zip")
    whole = path.read_bytes()
    refused = 0
    for at in range(len(whole)):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        try:
            for member in list_members(path):
                check_member(path, member, "")
                assert read_member(path, member) in (b"", b"a text " * 50)
        except BadInputError:
            refused += 1
    assert refused > len(whole) / 2


@pytest.mark.parametrize("packed", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_member_that_is_shorter_than_announced_is_damaged(tmp_path: Path, packed: int):
    path = write(tmp_path / "a.zip", packed)
    member = next(m for m in list_members(path) if m.file_size)
    assert len(read_member(path, member)) == member.file_size
    member.file_size += 1
    with pytest.raises(BadInputError, match=f"{member.filename} in .*a.zip is damaged"):
        read_member(path, member)

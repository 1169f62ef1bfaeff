import errno
import io
import tarfile
import zipfile

import pytest

from sips_lit.dataset_tools import unpack as unpacking
from sips_lit.dataset_tools.unpack import unpack
from sips_lit.errors import BadInputError


def make_zip(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def make_tar(path, members):
    with tarfile.open(path, "w:gz") as archive:
        for name, content in members.items():
            info = tarfile.TarInfo(name)
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return path


@pytest.mark.parametrize(("make", "name"), [(make_zip, "a.zip"), (make_tar, "a.tgz")])
def test_files_come_out_as_they_went_in(tmp_path, make, name):
    archive = make(tmp_path / name, {"a/1.png": b"one", "b.txt": b"two"})
    assert unpack(archive, tmp_path / "out") == 2
    assert (tmp_path / "out/a/1.png").read_bytes() == b"one"
    assert (tmp_path / "out/b.txt").read_bytes() == b"two"


@pytest.mark.parametrize(("make", "name"), [(make_zip, "a.zip"), (make_tar, "a.tgz")])
@pytest.mark.parametrize("member", ["../evil", "/etc/evil", "a/../../evil", "..\\evil", "C:/evil"])
def test_a_path_that_leaves_the_target_is_refused_before_anything_is_written(tmp_path, make, name, member):
    archive = make(tmp_path / name, {"fine": b"fine", member: b"evil"})
    with pytest.raises(BadInputError, match="outside of the target"):
        unpack(archive, tmp_path / "out")
    assert not list((tmp_path / "out").iterdir())
    assert not (tmp_path / "evil").exists()


@pytest.mark.parametrize(("make", "name"), [(make_zip, "a.zip"), (make_tar, "a.tgz")])
def test_a_link_in_the_target_is_not_followed_out_of_it(tmp_path, make, name):
    (tmp_path / "outside").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out/images").symlink_to(tmp_path / "outside")
    with pytest.raises(BadInputError, match="through a link"):
        unpack(make(tmp_path / name, {"images/1.png": b"one"}), tmp_path / "out")
    assert not list((tmp_path / "outside").iterdir())


def test_links_are_refused(tmp_path):
    with tarfile.open(tmp_path / "a.tar", "w") as archive:
        link = tarfile.TarInfo("link")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc"
        archive.addfile(link)
    with pytest.raises(BadInputError, match="link"):
        unpack(tmp_path / "a.tar", tmp_path / "out")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        info = zipfile.ZipInfo("link")
        info.external_attr = 0o120777 << 16
        archive.writestr(info, "/etc")
    with pytest.raises(BadInputError, match="link"):
        unpack(tmp_path / "a.zip", tmp_path / "out")


def test_a_bomb_is_refused_before_all_of_it_is_unpacked(tmp_path, monkeypatch):
    archive = make_tar(tmp_path / "a.tgz", {f"zeros{i}": bytes(10**6) for i in range(9)})
    seen = []
    monkeypatch.setattr(unpacking, "_check_member", lambda name, *_: seen.append(name))
    with pytest.raises(BadInputError, match="times its size"):
        unpack(archive, tmp_path / "out")
    assert len(seen) < 5


@pytest.mark.parametrize(("make", "name"), [(make_zip, "a.zip"), (make_tar, "a.tgz")])
def test_a_bomb_is_refused(tmp_path, make, name):
    archive = make(tmp_path / name, {"zeros": bytes(20_000_000)})
    with pytest.raises(BadInputError, match="times its size"):
        unpack(archive, tmp_path / "out")


def test_a_header_that_lies_about_the_size_is_found_out(tmp_path):
    archive = make_zip(tmp_path / "a.zip", {"zeros": bytes(20_000_000)})
    data = archive.read_bytes()
    place = data.index(b"PK\x01\x02") + 24  # of the unpacked size, in the table of contents
    archive.write_bytes(data[:place] + (1000).to_bytes(4, "little") + data[place + 4 :])
    with pytest.raises(BadInputError, match=r"a\.zip is damaged"):
        unpack(archive, tmp_path / "out")
    assert sum(file.stat().st_size for file in (tmp_path / "out").iterdir()) <= 1000  # of 20 MB


def test_a_truncated_archive_is_named(tmp_path):
    with tarfile.open(tmp_path / "a.tar", "w") as archive:
        info = tarfile.TarInfo("a")
        info.size = 100_000
        archive.addfile(info, io.BytesIO(bytes(range(250)) * 400))
    (tmp_path / "a.tar").write_bytes((tmp_path / "a.tar").read_bytes()[:50_000])
    with pytest.raises(BadInputError, match=r"a\.tar is damaged"):
        unpack(tmp_path / "a.tar", tmp_path / "out")


def test_what_does_not_fit_is_refused(tmp_path, monkeypatch):
    archive = make_zip(tmp_path / "a.zip", {"a": bytes(range(256)) * 8})
    usage = unpacking.shutil.disk_usage(tmp_path)
    monkeypatch.setattr(unpacking.shutil, "disk_usage", lambda path: usage._replace(free=unpacking.SPARE_BYTES + 100))
    with pytest.raises(BadInputError, match="GB free"):
        unpack(archive, tmp_path / "out")


@pytest.mark.parametrize("name", ["a.zip", "a.tgz"])
def test_a_damaged_archive_is_named(tmp_path, name):
    make = make_zip if name == "a.zip" else make_tar
    archive = make(tmp_path / name, {"a": bytes(range(256)) * 64})
    content = bytearray(archive.read_bytes())
    content[60:90] = b"x" * 30
    archive.write_bytes(bytes(content))
    with pytest.raises(BadInputError, match=f"{name} is damaged"):
        unpack(archive, tmp_path / "out")


@pytest.mark.parametrize("name", ["a.zip", "a.tgz", "a.tar"])
def test_whichever_byte_is_damaged_it_is_one_sentence(tmp_path, name):
    """Or the archive is unpacked: not all bytes are used."""
    if name == "a.tar":
        with tarfile.open(tmp_path / name, "w") as archive:
            info = tarfile.TarInfo("b/" + "long" * 40)
            info.size = 20
            archive.addfile(info, io.BytesIO(bytes(20)))
    else:
        (make_zip if name == "a.zip" else make_tar)(tmp_path / name, {"b/c.txt": b"some text " * 20})
    whole = (tmp_path / name).read_bytes()
    refused = 0
    for at in range(0, min(len(whole), 600), 2):
        (tmp_path / name).write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        try:
            unpack(tmp_path / name, tmp_path / "out" / str(at))
        except BadInputError as error:
            refused += str(error).isprintable()
    assert refused > 30


def test_a_full_disk_is_no_damage(tmp_path, monkeypatch):
    def extract(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    archive = make_zip(tmp_path / "a.zip", {"a": b"one"})
    monkeypatch.setattr(zipfile.ZipFile, "extract", extract)
    with pytest.raises(OSError, match="No space left"):
        unpack(archive, tmp_path / "out")

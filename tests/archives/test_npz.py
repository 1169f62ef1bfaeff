import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from sips_lit.archives import zip_members
from sips_lit.archives.npz import npz_members, read_array, read_npz
from sips_lit.errors import BadInputError


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_as_numpy_reads_it(tmp_path: Path, save):
    arrays = {
        "halves": np.arange(12, dtype=np.float16).reshape(3, 4),
        "columns": np.asfortranarray(np.arange(6).reshape(2, 3)),
        "big_endian": np.arange(3, dtype=">i4"),
        "text": np.array("a sentence"),
        "nothing": np.zeros((0, 2)),
        "a/b": np.array([True, False]),
    }
    save(tmp_path / "a.npz", **arrays)
    with np.load(tmp_path / "a.npz") as expected:
        read = read_npz(tmp_path / "a.npz")
        assert list(read) == list(expected)
        for name, array in read.items():
            np.testing.assert_array_equal(array, expected[name])
            assert (array.dtype, array.flags.writeable) == (expected[name].dtype, True)
    assert list(read_npz(tmp_path / "a.npz", {"halves", "absent"})) == ["halves"]


class Evil:
    def __reduce__(self):
        return os.mkdir, ("made_by_a_pickle",)


@pytest.mark.parametrize(
    "value", [np.array([Evil()], object), np.zeros(2, [("x", "f4")]), np.zeros(2, "M8[s]"), np.zeros(2, "V3")]
)
def test_only_numbers_and_text(tmp_path: Path, value, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez(tmp_path / "a.npz", x=value)
    with pytest.raises(BadInputError, match=r"x\.npy in .*a\.npz is not a plain array of numbers"):
        read_npz(tmp_path / "a.npz")
    assert not (tmp_path / "made_by_a_pickle").exists()


def write_member(path: Path, data: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", data)
    return path


def header(text: str) -> bytes:
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"no array",
        header("{'descr': '<f4', 'fortran_order': False, 'shape': (3000000000000,)}") + bytes(8),
        header("{'descr': '<f4', 'fortran_order': False, 'shape': (-2,)}") + bytes(8),
        header("{'descr': '<f4', 'fortran_order': False, 'shape': (1,)}") + bytes(8),
        header("{'descr': '<f4', 'fortran_order': False, 'shape': (2L,)") + bytes(8),  # numpy's parser of tokens fails
        header("{'descr': '|S0', 'fortran_order': False, 'shape': (2,)}") + bytes(8),
        header("[" * 500) + bytes(8),
        b"\x93NUMPY\x09\x00" + bytes(20),
    ],
)
def test_headers_that_lie(tmp_path: Path, data: bytes):
    path = write_member(tmp_path / "a.npz", data)
    with pytest.raises(BadInputError, match=r"x\.npy in .*a\.npz is not a plain array of numbers, or is damaged"):
        read_array(path, npz_members(path)["x"])


def test_an_archive_that_claims_too_much(tmp_path: Path, monkeypatch):
    """Zeros are small when they are packed, but not in memory: each array would be allowed, but not both."""
    monkeypatch.setattr(zip_members, "LARGEST", 8500)
    np.savez_compressed(tmp_path / "a.npz", a=np.zeros(1000), b=np.zeros(1000))
    assert len(read_npz(tmp_path / "a.npz", ("b",))["b"]) == 1000
    with pytest.raises(BadInputError, match=r"a\.npz claims more bytes than there can be"):
        read_npz(tmp_path / "a.npz")


def test_every_damaged_byte_is_noticed_or_changes_nothing(tmp_path: Path):
    """Whichever byte of an archive is changed: the same values, fewer names, or one sentence."""
    path, values = tmp_path / "a.npz", np.arange(40, dtype=np.float32)
    np.savez_compressed(path, x=values)
    whole = path.read_bytes()
    refused = 0
    for at in range(len(whole)):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        try:
            for array in read_npz(path).values():
                np.testing.assert_array_equal(array, values)
        except BadInputError:
            refused += 1
    assert refused > len(whole) / 2

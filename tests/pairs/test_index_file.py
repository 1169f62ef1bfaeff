import os
from pathlib import Path

import numpy as np
import pytest
from overlap_rows import index_of
from textured_scenes import flight

from sips_lit.errors import BadInputError
from sips_lit.pairs.index_file import index_path, load_index, save_index
from sips_lit.pairs.overlap import OverlapIndex, OverlapParameters

WHY = {2: "a/2.png is damaged: replace or remove it"}
INDEX = index_of([[5, 3], [2], []], [7, 6, 4], [[1.5, -20, 0.25], [3, 0, 1], [700, 90, -1]], WHY)
SIGNATURE = {"version": 1, "spacing": 16, "tracker": {"margin": 4.0}, "name": "café"}


def same(a: OverlapIndex, b: OverlapIndex) -> bool:
    arrays = all(
        np.array_equal(getattr(a, key), getattr(b, key)) for key in ("survivors", "motion", "offsets", "points")
    )
    return arrays and a.unreadable == b.unreadable


def test_what_was_saved_is_loaded(tmp_path):
    path = tmp_path / "new" / "folder" / "a.npz"
    save_index(path, INDEX, SIGNATURE)
    loaded = load_index(path, SIGNATURE)
    assert loaded is not None
    assert same(loaded, INDEX)
    assert loaded.survivors.dtype == np.uint16


@pytest.mark.parametrize(
    "change", [{"version": 2}, {"spacing": 8}, {"tracker": {"margin": 5.0}}, {"name": "cafe"}, {"more": 1}]
)
def test_another_signature_is_stale(tmp_path, change):
    save_index(tmp_path / "a.npz", INDEX, SIGNATURE)
    assert load_index(tmp_path / "a.npz", {**SIGNATURE, **change}) is None


def test_a_real_signature_survives_the_file(tmp_path):
    signature = OverlapParameters().signature(flight(2))
    save_index(tmp_path / "a.npz", INDEX, signature)
    assert load_index(tmp_path / "a.npz", signature) is not None


def test_no_file_no_index(tmp_path):
    assert load_index(tmp_path / "missing.npz", SIGNATURE) is None
    assert load_index(tmp_path, SIGNATURE) is None


def test_damaged_files_are_no_index(tmp_path):
    path = tmp_path / "a.npz"
    save_index(path, INDEX, SIGNATURE)
    whole = path.read_bytes()
    for length in [*range(40), *range(40, len(whole) - 1, 37), len(whole) - 1]:
        path.write_bytes(whole[:length])
        assert load_index(path, SIGNATURE) is None, length
    for text in (b"not an index at all", b"\x00" * 500):
        path.write_bytes(text)
        assert load_index(path, SIGNATURE) is None


def test_flipped_bytes_never_give_another_index(tmp_path):
    path = tmp_path / "a.npz"
    save_index(path, INDEX, SIGNATURE)
    whole = path.read_bytes()
    for at in range(0, len(whole), 3):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1 :])
        loaded = load_index(path, SIGNATURE)  # a byte that means nothing (a date) may be flipped
        assert loaded is None or same(loaded, INDEX), at


def test_a_file_with_other_arrays_is_no_index(tmp_path):
    np.savez(tmp_path / "a.npz", survivors=np.zeros(3))
    assert load_index(tmp_path / "a.npz", SIGNATURE) is None
    np.save(tmp_path / "b.npy", np.zeros(3))
    assert load_index(tmp_path / "b.npy", SIGNATURE) is None


def test_nothing_temporary_stays(tmp_path):
    for _ in range(2):
        save_index(tmp_path / "a.npz", INDEX, SIGNATURE)
        assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


@pytest.mark.parametrize(("owner", "function"), [(os, "fsync"), (Path, "replace")])
def test_a_write_that_fails_leaves_the_old_index(tmp_path, monkeypatch, owner, function):
    path = tmp_path / "a.npz"
    save_index(path, INDEX, SIGNATURE)

    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(owner, function, full_disk)
    longer = index_of([[1] * 99], 9)
    with pytest.raises(BadInputError, match=r"cannot write .*a\.npz: the disk .* is full \(No space left on device\)"):
        save_index(path, longer, SIGNATURE)
    monkeypatch.undo()
    loaded = load_index(path, SIGNATURE)
    assert loaded is not None
    assert same(loaded, INDEX)
    assert [item.name for item in tmp_path.iterdir()] == ["a.npz"]


def test_a_folder_that_is_a_file(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInputError, match="cannot make the folder"):
        save_index(tmp_path / "file" / "a.npz", INDEX, SIGNATURE)


def test_each_sequence_has_a_path_of_its_own(tmp_path):
    same_name, other_frames = flight(2, name="a"), flight(2, seed=4, name="a")
    paths = {index_path(tmp_path, s) for s in (same_name, other_frames, flight(2, name="b"))}
    assert len(paths) == 3
    assert index_path(tmp_path, same_name) == index_path(tmp_path, flight(2, name="a"))
    assert index_path(tmp_path, same_name).name.startswith("a-")

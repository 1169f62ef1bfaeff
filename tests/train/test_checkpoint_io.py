import errno
import os
import warnings

import pytest
import torch

from sips_lit.detect.checkpoint import is_sound
from sips_lit.errors import BadInputError, InputWarning
from sips_lit.train.checkpoint_io import WholeCheckpointIO, previous_of, sound_checkpoint


def saved(path, number: int, size: int = 1000) -> None:
    WholeCheckpointIO().save_checkpoint({"weights": torch.full((size,), float(number)), "number": number}, str(path))


def number_in(path) -> int:
    stored = torch.load(path, weights_only=True)
    assert (stored["weights"] == stored["number"]).all()
    return stored["number"]


def names(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def flip_a_bit(path) -> None:
    content = bytearray(path.read_bytes())
    content[content.find(torch.full((100,), float(number_in(path))).numpy().tobytes()) + 200] ^= 1
    path.write_bytes(content)


def test_the_checkpoint_before_is_kept(tmp_path):
    last = tmp_path / "new" / "folder" / "last.ckpt"
    saved(last, 1)
    assert names(last.parent) == ["last.ckpt"]
    saved(last, 2)
    saved(last, 3)
    assert (number_in(last), number_in(previous_of(last))) == (3, 2)
    assert names(last.parent) == ["last.ckpt", "last.previous.ckpt"]


def test_a_file_system_without_hard_links(tmp_path, monkeypatch):
    def refused(*_):
        raise OSError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", refused)
    for number in (1, 2, 3):
        saved(tmp_path / "last.ckpt", number)
    assert (number_in(tmp_path / "last.ckpt"), number_in(tmp_path / "last.previous.ckpt")) == (3, 2)
    assert names(tmp_path) == ["last.ckpt", "last.previous.ckpt"]


@pytest.mark.parametrize("call", ["torch.save", "os.fsync", "os.link", "os.replace"])
def test_a_stop_at_any_moment_leaves_two_whole_checkpoints(tmp_path, monkeypatch, call):
    """As a kill would, but that what is unfinished is cleared away at once and not by the next checkpoint."""
    last = tmp_path / "last.ckpt"
    saved(last, 1)
    saved(last, 2)
    seen: list[int] = []

    def stopped(*_, **__):
        seen.append(len(seen))
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(call, stopped)
        if call == "os.replace":
            patch.setattr("pathlib.Path.replace", stopped)
        with pytest.raises(KeyboardInterrupt):
            saved(last, 3)
    assert seen == [0]
    assert number_in(last) == 2
    assert number_in(previous_of(last)) == 1
    saved(last, 4)
    assert (number_in(last), number_in(previous_of(last))) == (4, 2)
    assert names(tmp_path) == ["last.ckpt", "last.previous.ckpt"]


def test_what_a_kill_left_is_cleared_up(tmp_path):
    last = tmp_path / "last.ckpt"
    saved(last, 1)
    for name in (".last.ckpt.new.0123456789ab.tmp", ".last.ckpt.old", "last.ckpt.new"):
        (tmp_path / name).write_bytes(b"half of it")
    (tmp_path / ".best.ckpt.old").write_bytes(b"of another")
    saved(last, 2)
    assert names(tmp_path) == [".best.ckpt.old", "last.ckpt", "last.previous.ckpt"]


def test_a_kill_between_the_two_names_is_no_obstacle(tmp_path):
    last = tmp_path / "last.ckpt"
    saved(last, 1)
    os.link(last, previous_of(last))  # one file of two names
    saved(last, 2)
    assert (number_in(last), number_in(previous_of(last))) == (2, 1)
    assert names(tmp_path) == ["last.ckpt", "last.previous.ckpt"]


def test_a_damaged_checkpoint_does_not_replace_the_sound_one_before_it(tmp_path):
    last = tmp_path / "last.ckpt"
    saved(last, 1)
    saved(last, 2)
    flip_a_bit(last)
    saved(last, 3)
    assert (number_in(last), number_in(previous_of(last))) == (3, 1)


def test_a_full_disk_keeps_both_and_is_named(full_disk):
    last = full_disk / "last.ckpt"
    saved(last, 1, 30_000)
    saved(last, 2, 30_000)
    with pytest.raises(BadInputError, match=rf"cannot write .*last\.ckpt.*: the disk {full_disk} is full"):
        saved(last, 3, 500_000)  # 2 MB
    assert (number_in(last), number_in(previous_of(last))) == (2, 1)
    assert names(full_disk) == ["last.ckpt", "last.previous.ckpt"]


def test_a_disk_that_is_full_while_the_old_one_is_copied(tmp_path, monkeypatch):
    def refused(*_):
        raise OSError(errno.EPERM, "Operation not permitted")

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    saved(tmp_path / "last.ckpt", 1)
    monkeypatch.setattr(os, "link", refused)
    monkeypatch.setattr("shutil.copyfile", full)
    with pytest.raises(BadInputError, match="is full"):
        saved(tmp_path / "last.ckpt", 2)
    assert number_in(tmp_path / "last.ckpt") == 1


@pytest.mark.parametrize("damage", ["empty", "half", "bit", "gone"])
def test_a_damaged_last_falls_back_to_the_one_before(tmp_path, damage):
    last = tmp_path / "last.ckpt"
    saved(last, 1)
    saved(last, 2)
    assert sound_checkpoint(last) == last
    if damage == "bit":
        flip_a_bit(last)
    elif damage == "gone":
        last.unlink()
    else:
        last.write_bytes(last.read_bytes()[: last.stat().st_size // 2] if damage == "half" else b"")
    assert not is_sound(last)
    with pytest.warns(InputWarning, match=r"last\.ckpt is damaged: going on from the checkpoint before it, .*previous"):
        assert number_in(sound_checkpoint(last)) == 1


def test_without_a_sound_one_before_the_damaged_one_is_told_by_who_reads_it(tmp_path):
    last = tmp_path / "last.ckpt"
    last.write_bytes(b"nonsense")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sound_checkpoint(last) == last
        previous_of(last).write_bytes(b"nonsense, too")
        assert sound_checkpoint(last) == last
